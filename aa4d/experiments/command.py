"""What `aa4d ablate`, `aa4d sweep` and `aa4d compare` share: arguments become trials, rows become printed tables."""

from __future__ import annotations

from pathlib import Path

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from aa4d.console import console, graph_listener
from aa4d.errors import InputError
from aa4d.experiments.kinds.evaluate import Row
from aa4d.experiments.tables import cells, columns_of, headings, lines_of, write_tables
from aa4d.experiments.trials import Outcome, run_experiment, trials_of
from aa4d.experiments.variants import Experiment
from aa4d.graph.engines import Means, engine_of
from aa4d.methods.adaanchor4d.settings import PRESETS, AdaAnchor4DSettings
from aa4d.methods.settings import with_iterations
from aa4d.reports.report import closing_line
from aa4d.settings.given import Given, Options

WIDTH = 180


def run(
    experiment: Experiment,
    captures: tuple[Path, ...],
    out: Path,
    *,
    preset: str | None,
    config: Path | None,
    assignments: tuple[str, ...],
    iterations: tuple[int, int] | None,
    seeds: int,
    motion: str | None,
    jobs: int,
    engine: str,
    address: str | None,
) -> None:
    """Raises InputError for a number that makes no sense, and what `run_experiment` raises."""
    check_given(experiment.name, captures, seeds, jobs, iterations)
    options: Options = {"--preset": ("preset", preset), "--motion": ("motion", {} if motion == "tracks" else motion)}
    given = Given.by(config, assignments, options)
    given.chosen("method", [AdaAnchor4DSettings.method], AdaAnchor4DSettings.method)
    settings = given.applied(PRESETS[given.chosen("preset", PRESETS, "quick")], chosen=["method", "preset"])
    if iterations is not None:
        settings = with_iterations(settings, *iterations)
    trials = trials_of(experiment, captures, out, settings, seeds)

    def write(outcome: Outcome) -> None:
        if outcome.rows:
            write_tables(experiment, outcome.rows, out)

    worker = engine_of(engine, Means(jobs, address))
    with graph_listener(worker.slots) as listen:
        rows = run_experiment(experiment, trials, out, worker, listen, write).checked()
    print_rows(experiment, rows)
    console.print(
        f"{settings.coarse_iterations} + {settings.fine_iterations} iterations; "
        "± is the standard deviation over seeds\n"
        f"tables: {out / 'table.md'}, {out / 'pooled.md'}, {out / 'rows.csv'}\nplot:   {out / 'plot.png'}\n"
        f"{closing_line(out)}",
        highlight=False,
        soft_wrap=True,
    )


def check_given(
    name: str, captures: tuple[Path, ...], seeds: int, jobs: int, iterations: tuple[int, int] | None
) -> None:
    """Raises InputError for a number that makes no sense, or where no capture is named."""
    if not captures:
        raise InputError(f"{name}: name at least one capture folder, made by `aa4d synth` or `aa4d capture`")
    for option, value in (("--seeds", seeds), ("--jobs", jobs), ("--iterations", min(iterations or (1,)))):
        if value < 1:
            raise InputError(f"{option} {value}: must be at least 1")


def print_rows(experiment: Experiment, rows: list[Row]) -> None:
    """A table for each capture."""
    columns = columns_of(rows)
    lines = lines_of(experiment, rows)
    for capture in dict.fromkeys(line.capture for line in lines):
        here = [cells(line, columns) for line in lines if line.capture == capture]
        print_table(f"{experiment.title}: {capture}", headings(columns), here)


def print_table(title: str, headings: list[str], rows: list[list[str]]) -> None:
    """In a narrow terminal or a log, lines that wrap are better than numbers cut short."""
    table = Table(title=title, box=SIMPLE, title_justify="left", padding=(0, 1, 0, 0))
    for number, heading in enumerate(headings):
        table.add_column(heading, justify="right" if number else "left", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    Console(width=max(console.width, WIDTH), markup=False).print(table, crop=False)
