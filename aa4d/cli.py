"""The command line: `aa4d synth | train | eval | demo`."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table
from tyro.conf import Positional, arg

from aa4d.errors import InputError, Interrupted

DESCRIPTION = (
    "AdaAnchor4D: drone video of moving traffic becomes a 4D scene that you can scrub in Blender. "
    "`aa4d demo` does it all; the other commands are its steps. Every command can be stopped and run again."
)
# OpenMP's idle threads spin for milliseconds by default. Where another program wants a core, each of the hundreds of
# short parallel regions of an iteration then waits for a spinning thread's time slice: up to 8 times slower with two
# busy cores, and no faster on idle ones. Read when torch is loaded, hence here.
os.environ.setdefault("GOMP_SPINCOUNT", "2000")

SECONDS_BETWEEN_LINES = 10.0
console = Console()
app = tyro.extras.SubcommandApp()


@app.command
def synth(
    scene: Annotated[Positional[Path], arg(help="Scene file, for instance scenes/crossroads.toml.")],
    out: Annotated[Path, arg(help="Folder for the capture: new, empty, or an unfinished capture of this scene.")],
) -> None:
    """Render a flyover with Blender: frames, exact poses, depth and ids, as a capture folder."""
    from aa4d.blender import run_in_blender

    code = run_in_blender("synth/render_flyover.py", str(scene), "--out", str(out))
    if code != 0:
        sys.exit(code if code > 0 else 1)


@app.command
def train(
    capture: Annotated[Positional[Path], arg(help="Capture folder, made by `aa4d synth`.")],
    out: Annotated[Path, arg(help="Folder for the run: new, empty, or this run where it stopped.")],
    preset: Annotated[
        Literal["quick", "paper"], arg(help="quick: minutes on two cores. paper: its schedule.")
    ] = "quick",
    seed: Annotated[int, arg(help="Of everything random.")] = 0,
) -> None:
    """Train AdaAnchor4D on a capture; Ctrl-C stops it, and the same command continues."""
    from aa4d.capture.reader import read_capture
    from aa4d.training.config import PRESETS
    from aa4d.training.trainer import train as run_training

    if seed < 0:
        raise InputError(f"--seed {seed}: must not be negative")
    config = replace(PRESETS[preset], seed=seed)
    with training_progress() as progress:
        model = run_training(read_capture(capture), out, config, progress)
    console.print(f"model: {model}")


@app.command(name="eval")
def evaluate(
    run: Annotated[Positional[Path], arg(help="Folder of a run, made by `aa4d train`.")],
    capture: Annotated[Path | None, arg(help="Capture folder, where it has moved since training.")] = None,
) -> None:
    """Score a run on the held-out frames and time its rendering; writes metrics.json."""
    from aa4d.evaluation.evaluate import evaluate as run_evaluation

    with step_progress("held-out frames") as progress:
        metrics = run_evaluation(run, capture, progress)
    console.print(metrics_table(metrics.as_json()))
    console.print(f"metrics: {run / 'metrics.json'}\nrenders: {run / 'eval'}")


@app.command
def demo(
    scene: Annotated[Positional[Path], arg(help="Scene file.")] = Path("scenes/crossroads.toml"),
    out: Annotated[Path, arg(help="Folder for everything the demo makes.")] = Path("demo"),
) -> None:
    """The main job: render a scene, train, evaluate, show the result in Blender. Continues where it stopped."""
    from aa4d.demo import run_demo
    from aa4d.training.config import PRESETS

    run_demo(scene, out, PRESETS["quick"], console, training_progress, step_progress)


@app.command
def bench(
    what: Annotated[
        Positional[Literal["raster", "precision", "scaling"]],
        arg(help="The rasteriser's speed, what its precisions cost and leave, or how its time grows."),
    ],
    json: Annotated[Path | None, arg(help="File to write the rows of `raster` to, for machines.")] = None,
    repeats: Annotated[int, arg(help="Runs of each scene; the best counts.")] = 7,
) -> None:
    """Measure the CPU rasteriser on this machine, on random scenes."""
    from aa4d.raster import bench as measure

    if repeats < 1:
        raise InputError(f"--repeats {repeats}: must be at least 1")
    if json is not None and not json.parent.is_dir():
        raise InputError(f"--json {json}: there is no folder {json.parent}")
    if what == "raster":
        measure.bench(repeats=repeats, json_path=json, console=console)
    elif what == "precision":
        measure.bench_precision(repeats, console)
    else:
        measure.bench_scaling(repeats, console)


@contextmanager
def training_progress() -> Iterator[TrainingBar]:
    with Progress(
        TextColumn("{task.description:>7}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[state]}"),
        console=console,
        disable=not console.is_terminal,
    ) as bar:
        yield TrainingBar(bar)


class TrainingBar:
    """One bar a stage, with the running means of loss and PSNR."""

    def __init__(self, bar: Progress) -> None:
        self._bar = bar
        self._spoken = time.monotonic()
        self._tasks: dict[str, tuple[TaskID, list[float]]] = {}

    def __call__(self, stage: str, iteration: int, total: int, loss: float, psnr_db: float, anchors: int) -> None:
        if stage not in self._tasks:
            self._tasks[stage] = (self._bar.add_task(stage, total=total, completed=iteration - 1, state=""), [])
        task, recent = self._tasks[stage]
        recent.append(psnr_db)
        del recent[:-50]
        mean = sum(recent) / len(recent)
        state = f"loss {loss:.4f}  psnr {mean:.1f} dB  {anchors} anchors"
        self._bar.update(task, completed=iteration, state=state)
        # In a log file a bar cannot move: there, a line now and then.
        now = time.monotonic()
        if not console.is_terminal and (iteration == total or now - self._spoken >= SECONDS_BETWEEN_LINES):
            self._spoken = now
            left = self._bar.tasks[task].time_remaining
            remaining = "" if left is None else f"  {left:.0f} s left"
            console.print(f"{stage} {iteration}/{total}  {state}{remaining}", highlight=False, soft_wrap=True)


@contextmanager
def step_progress(description: str) -> Iterator[StepBar]:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        yield StepBar(bar, description)


class StepBar:
    def __init__(self, bar: Progress, description: str) -> None:
        self._bar = bar
        self._task = bar.add_task(description, total=None)

    def __call__(self, done: int, total: int) -> None:
        self._bar.update(self._task, completed=done, total=total)


def metrics_table(metrics: dict) -> Table:
    """Quality beside cost, the full model beside itself frozen at its coarse stage."""
    table = Table(title="held-out frames")
    table.add_column("")
    table.add_column("AdaAnchor4D", justify="right")
    table.add_column("coarse (static)", justify="right")

    def db(value: float | None) -> str:
        return "not measured" if value is None else f"{value:.2f} dB"

    table.add_row("PSNR", db(metrics["psnr"]), db(metrics["psnr_static"]))
    table.add_row("PSNR, moving pixels", db(metrics["psnr_dynamic"]), db(metrics["psnr_dynamic_static"]))
    table.add_row("SSIM", f"{metrics['ssim']:.4f}", "")
    width, height = metrics["resolution"]
    table.add_row("rendering", f"{metrics['fps']:.1f} fps at {width}x{height}, {metrics['threads']} thread(s)", "")
    table.add_row("training", f"{metrics['training_seconds']:.0f} s", "")
    table.add_row("anchors / Gaussians drawn", f"{metrics['anchors']} / {metrics['gaussians']}", "")
    table.add_row("neural size / model file", f"{metrics['neural_mib']:.2f} / {metrics['total_mib']:.2f} MiB", "")
    return table


def main() -> None:
    try:
        app.cli(prog="aa4d", description=DESCRIPTION)
    except InputError as error:
        Console(stderr=True).print(f"aa4d: {error}", markup=False, highlight=False, soft_wrap=True)
        sys.exit(2)
    except Interrupted as stop:
        Console(stderr=True).print(f"aa4d: {stop}", markup=False, highlight=False, soft_wrap=True)
        sys.exit(130)
    except KeyboardInterrupt:
        Console(stderr=True).print("aa4d: stopped", markup=False)
        sys.exit(130)


if __name__ == "__main__":
    main()
