"""The console, and the progress bars that commands share."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

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

SECONDS_BETWEEN_LINES = 10.0
console = Console(markup=False)  # a path may hold brackets


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
        self._last_log_time = time.monotonic()
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
        if not console.is_terminal and (iteration == total or now - self._last_log_time >= SECONDS_BETWEEN_LINES):
            self._last_log_time = now
            left = self._bar.tasks[task].time_remaining
            remaining = "" if left is None else f"  {left:.0f} s left"
            console.print(f"{stage} {iteration}/{total}  {state}{remaining}", highlight=False, soft_wrap=True)


@contextmanager
def experiment_progress() -> Iterator[ExperimentBar]:
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(elapsed_when_finished=True),
        TextColumn("{task.fields[state]}"),
        console=console,
        disable=not console.is_terminal,
    ) as bar:
        yield ExperimentBar(bar)


class ExperimentBar:
    """One bar over the iterations of all runs, and a line for each run that ends."""

    def __init__(self, bar: Progress) -> None:
        self._bar = bar
        self._task: TaskID | None = None
        self._at: dict[str, int] = {}
        self._runs = self._ended = self._iterations = 0
        self._started = time.monotonic()

    def start(self, trials: int, finished: int, iterations: int) -> None:
        self._runs, self._ended, self._iterations = trials, finished, iterations
        self._started = time.monotonic()
        if finished:
            console.print(f"{finished} of {trials} runs were done before", highlight=False)
        self._task = self._bar.add_task("runs", total=iterations, state="")

    def trial_started(self, name: str) -> None:
        self._at[name] = 0
        self._show()

    def trial_at(self, name: str, iterations: int) -> None:
        self._at[name] = iterations
        self._show()

    def trial_ended(self, name: str, sentence: str) -> None:
        self._ended += 1
        line = f"{self._ended}/{self._runs}  {name}: {sentence}"
        if not console.is_terminal:  # where there is no bar
            line += self._left()
        console.print(line, highlight=False, soft_wrap=True)

    def _left(self) -> str:
        """In minutes, at the mean pace so far; methods differ in theirs."""
        done = sum(self._at.values())
        if not done or self._ended == self._runs:
            return ""
        seconds = (time.monotonic() - self._started) / done * max(self._iterations - done, 0)
        return f"  (about {seconds / 60:.0f} min left)"

    def _show(self) -> None:
        if self._task is not None:
            state = f"{self._ended} of {self._runs} runs done"
            self._bar.update(self._task, completed=sum(self._at.values()), state=state)


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


@contextmanager
def capture_progress() -> Iterator[CaptureBars]:
    left = TimeRemainingColumn()
    columns = (TextColumn("{task.description:>9}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), left)
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        yield CaptureBars(bar)


class CaptureBars:
    """One line a step; lines now and then where the output is a file."""

    def __init__(self, bar: Progress) -> None:
        self._bar = bar
        self._last_log_time = time.monotonic()

    def step(self, name: str, was_done: bool) -> StepLine:
        task = self._bar.add_task(name, total=1 if was_done else None, completed=1 if was_done else 0)
        if was_done and not console.is_terminal:
            console.print(f"{name}: done before", highlight=False)
        return StepLine(self, name, task)

    def update(self, name: str, task: TaskID, done: int, total: int | None) -> None:
        self._bar.update(task, completed=done, total=total)
        now = time.monotonic()
        finished = total is not None and done >= total and not self._bar.tasks[task].fields.get("logged")
        if not console.is_terminal and (finished or now - self._last_log_time >= SECONDS_BETWEEN_LINES):
            self._last_log_time = now
            self._bar.update(task, logged=finished)
            console.print(f"{name} {done}/{'?' if total is None else total}", highlight=False)


class StepLine:
    def __init__(self, display: CaptureBars, name: str, task: TaskID) -> None:
        self._display, self._name, self._task = display, name, task

    def __call__(self, done: int, total: int | None) -> None:
        self._display.update(self._name, self._task, done, total)
