"""What `aa4d ablate` and `aa4d sweep` have in common: arguments become trials, rows become printed tables."""

from __future__ import annotations

from pathlib import Path

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

from aa4d.console import console, experiment_progress
from aa4d.errors import InputError
from aa4d.experiments.runner import run_experiment, trials_of
from aa4d.experiments.tables import cells, columns_of, headings, lines_of
from aa4d.experiments.variants import Experiment
from aa4d.methods.adaanchor4d.settings import PRESETS, AdaAnchor4DSettings
from aa4d.methods.settings import with_iterations
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
) -> None:
    """Raises InputError for a number that makes no sense, and what `run_experiment` raises."""
    if not captures:
        raise InputError(f"{experiment.name}: name at least one capture folder, made by `aa4d synth`")
    for name, value in (("--seeds", seeds), ("--jobs", jobs), ("--iterations", min(iterations or (1,)))):
        if value < 1:
            raise InputError(f"{name} {value}: must be at least 1")
    methods = {variant.method for variant in experiment.variants}
    if len(methods) > 1 and (config is not None or assignments or motion is not None):
        raise InputError(
            f"{experiment.name}: methods have settings of their own, so that --config, --set and --motion would reach "
            "one of them alone; leave them out (--preset and --iterations hold for all)"
        )
    options: Options = {"--preset": ("preset", preset), "--motion": ("motion", {} if motion == "tracks" else motion)}
    given = Given.by(config, assignments, options)
    given.chosen("method", [AdaAnchor4DSettings.method], AdaAnchor4DSettings.method)
    settings = given.applied(PRESETS[given.chosen("preset", PRESETS, "quick")], chosen=["method", "preset"])
    if iterations is not None:
        settings = with_iterations(settings, *iterations)
    trials = trials_of(experiment, captures, out, settings, seeds)
    with experiment_progress() as bar:
        rows = run_experiment(experiment, trials, out, jobs, bar)
    columns = columns_of(rows)
    lines = lines_of(experiment, rows)
    # In a narrow terminal or a log, lines that wrap are better than numbers cut short.
    wide = Console(width=max(console.width, WIDTH), markup=False)
    for capture in dict.fromkeys(line.capture for line in lines):
        table = Table(title=f"{experiment.title}: {capture}", box=SIMPLE, title_justify="left", padding=(0, 1, 0, 0))
        for number, heading in enumerate(headings(columns)):
            table.add_column(heading, justify="right" if number else "left", no_wrap=True)
        for line in lines:
            if line.capture == capture:
                table.add_row(*cells(line, columns))
        wide.print(table, crop=False)
    console.print(
        f"{settings.coarse_iterations} + {settings.fine_iterations} iterations; "
        "± is the standard deviation over seeds\n"
        f"tables: {out / 'table.md'}, {out / 'pooled.md'}, {out / 'rows.csv'}\nplot:   {out / 'plot.png'}",
        highlight=False,
        soft_wrap=True,
    )
