"""`aa4d compare`: train and score what is missing, time it, and write tables, a plot and pictures."""

from __future__ import annotations

import os
from dataclasses import replace
from io import BytesIO
from pathlib import Path

from aa4d.capture.content import check_content
from aa4d.capture.reader import Capture, read_capture
from aa4d.console import console, graph_listener, step_progress
from aa4d.errors import InputError
from aa4d.experiments.command import check_given, print_table
from aa4d.experiments.comparison import base_settings, comparison_of, title_of
from aa4d.experiments.comparison_tables import POOLED, Comparison, failed_lines, table_of, write_comparison
from aa4d.experiments.pareto import plot_pareto
from aa4d.experiments.side_by_side import Panel, compose, crops_of, drawn_by, frames_to_show, truth_of
from aa4d.experiments.timing import time_runs
from aa4d.experiments.trials import Outcome, Trial, run_experiment, trials_of
from aa4d.files import claimed, make_folder, read_json_object, write_bytes
from aa4d.graph.engines import Means, engine_of
from aa4d.reports.report import closing_line

PARETO = "pareto.png"
PICTURES = "pictures"  # a folder
SHOWN = 2  # held-out frames of a capture


def compare(
    folders: tuple[Path, ...],
    out: Path,
    names: tuple[str, ...],
    *,
    preset: str,
    iterations: tuple[int, int] | None,
    seeds: int,
    jobs: int,
    engine: str,
    address: str | None,
) -> None:
    """Raises InputError for what cannot be compared, and, once all others are done, where a run failed."""
    experiment = comparison_of(names)
    check_given("compare", folders, seeds, jobs, iterations)
    settings = base_settings(experiment, preset, iterations)
    captures = _captures(folders)
    trials = trials_of(experiment, folders, out, settings, seeds)
    titles = {variant.label: title_of(variant.label) for variant in experiment.variants}
    threads = _threads()
    conditions = {
        "command": _command(folders, out, names, preset, iterations, seeds, jobs),
        "preset": preset,
        "coarse_iterations": settings.coarse_iterations,
        "fine_iterations": settings.fine_iterations,
        "seeds": sorted({trial.seed for trial in trials}),
        "jobs": jobs,
        "processors": os.cpu_count(),
        "threads": threads,
    }

    def write(outcome: Outcome, pictures: tuple[str, ...]) -> Comparison:
        comparison = Comparison.of(outcome, trials, titles, conditions)
        plot_pareto(comparison, out / PARETO)
        plots = [PARETO] if (out / PARETO).exists() else []
        write_comparison(comparison, out, [*plots, *pictures])
        return comparison

    worker = engine_of(engine, Means(jobs, address))
    with graph_listener(worker.slots) as listen:
        # Their speed is left out until it has been measured for all alike.
        outcome = run_experiment(experiment, trials, out, worker, listen, lambda found: write(_untimed(found), ()))
    with claimed(out, "comparing"):
        finished = [trial for trial in trials if trial.name not in outcome.failures]
        with step_progress("timing") as progress:
            speeds = time_runs(finished, threads, progress)
        timed = zip(finished, _untimed(outcome).rows, strict=True)
        rows = [row | speeds[trial.name] for trial, row in timed]
        first = [trial for trial in trials if trial.seed == settings.seed]
        pictures = [name for capture in captures for name in _pictures(capture, first, titles, outcome, out)]
        comparison = write(replace(outcome, rows=rows), tuple(pictures))
    _print(comparison)
    console.print(
        f"tables:   {out / 'compare.md'}, compare.json, table.csv, rows.csv\nplot:     {out / PARETO}\n"
        f"pictures: {out / PICTURES}\n{closing_line(out)}",
        highlight=False,
        soft_wrap=True,
    )
    outcome.checked()


def _captures(folders: tuple[Path, ...]) -> list[Capture]:
    """Raises InputError for one that cannot be trained and scored on, before anything is written."""
    captures = []
    for folder in folders:
        capture = read_capture(folder)
        check_content(folder)
        for split, purpose in (("train", "train on"), ("test", "compare on")):
            if not capture.of_split(split):
                raise InputError(f'{folder}: has no frame to {purpose} (split "{split}")')
        captures.append(capture)
    return captures


def _untimed(outcome: Outcome) -> Outcome:
    rows = [{key: value for key, value in row.items() if key not in ("fps", "fps_cached")} for row in outcome.rows]
    return replace(outcome, rows=rows)


def _threads() -> int:
    import torch

    return torch.get_num_threads()


def _command(
    folders: tuple[Path, ...],
    out: Path,
    names: tuple[str, ...],
    preset: str,
    iterations: tuple[int, int] | None,
    seeds: int,
    jobs: int,
) -> str:
    """What makes the same again, captures and folder by their names."""
    given = "" if iterations is None else f" --iterations {iterations[0]} {iterations[1]}"
    named = " ".join(folder.resolve().name for folder in folders)
    which = ",".join(names)
    return (
        f"aa4d compare {named} --methods {which} --preset {preset}{given} --seeds {seeds} --jobs {jobs} "
        f"--out {out.resolve().name}"
    )


def _pictures(capture: Capture, trials: list[Trial], titles: dict[str, str], outcome: Outcome, out: Path) -> list[str]:
    """Compose the held-out frames of a capture, all methods side by side; their names in `out`."""
    make_folder(out / PICTURES)
    here = [trial for trial in trials if trial.capture == capture.folder.resolve()]
    names = []
    for index in frames_to_show(capture, SHOWN):
        frame = capture.frames[index]
        panels = [Panel("Truth", truth_of(capture, index))]
        for trial in here:
            drawn = None if trial.name in outcome.failures else drawn_by(trial.out, capture, index)
            panels.append(Panel(titles[trial.label], drawn, _note(trial, frame.name)))
        named, seed = capture.folder.resolve().name, trials[0].seed
        caption = f"{named}, held-out frame {frame.name} at {frame.time_s:.2f} s, seed {seed}"
        name = f"{PICTURES}/{named}-{frame.name}.jpg"
        buffer = BytesIO()  # Pillow writes JPEG past Python, and takes what a full disk has no room for as written
        compose(panels, crops_of(capture, index), caption).save(buffer, format="JPEG", quality=92, subsampling=0)
        write_bytes(out / name, buffer.getvalue())
        names.append(name)
    return names


def _note(trial: Trial, frame: str) -> str:
    """PSNR of the frame, and of its moving pixels."""
    path = trial.out / "metrics.json"
    if not path.exists():
        return ""
    scores = next(score for score in read_json_object(path, "the scores of a run")["frames"] if score["frame"] == frame)
    moving = "" if scores["psnr_dynamic"] is None else f", moving {scores['psnr_dynamic']:.1f}"
    return f"{scores['psnr']:.1f} dB{moving}"


def _print(comparison: Comparison) -> None:
    means, pooled = comparison.means(), comparison.pooled()
    for capture in comparison.captures:
        headings, *lines = table_of(comparison, [mean for mean in means if mean.capture == capture])
        print_table(capture, headings, lines + failed_lines(comparison, capture, len(headings)))
    if len(comparison.pooled_over()) > 1:
        headings, *lines = table_of(comparison, pooled)
        print_table(POOLED, headings, lines)
