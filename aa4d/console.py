"""The console, and the progress bars that commands share."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from aa4d.graph.costs import Costs
from aa4d.graph.events import Advanced, Event, Failed, Finished, Said, Started
from aa4d.graph.remaining import Remaining
from aa4d.graph.task import Task
from aa4d.words import counted

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
def graph_listener(slots: int, costs: Costs | None = None) -> Iterator[Callable[[Sequence[Task]], GraphBar]]:
    """Gives what makes a listener for the tasks of a graph, in the order in which they are run.

    Args:
        slots: tasks that are run at a time.
        costs: what has been measured before.
    """
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
        TextColumn("{task.fields[state]}"),
        console=console,
        disable=not console.is_terminal,
    ) as bar:
        shown: list[GraphBar] = []

        def listen(tasks: Sequence[Task]) -> GraphBar:
            shown.append(GraphBar(bar, Remaining(tasks, costs or Costs(), slots)))
            return shown[0]

        yield listen
        for graph_bar in shown:
            graph_bar.tell_what_was()


class GraphBar:
    """Listens to the events of a graph: one bar over all tasks, and a line for each that ends."""

    def __init__(self, bar: Progress, remaining: Remaining) -> None:
        self._bar = bar
        self._remaining = remaining
        self._before = 0
        self._task = bar.add_task("tasks", total=1.0, state="")

    def __call__(self, event: Event) -> None:
        self._remaining(event)
        if isinstance(event, Finished) and event.before:
            self._before += 1  # hundreds of them: what is left is foretold once they are over
            return
        self.tell_what_was()
        if isinstance(event, Said):
            self._line(f"{event.task.title}: {event.text}")
        elif isinstance(event, Finished):
            psnr = event.kept.result.get("psnr")
            took = "" if event.kept.seconds is None else words_of(event.kept.seconds)
            self._ended(event.task.title, f"{psnr:.2f} dB" if isinstance(psnr, float) else took)
        elif isinstance(event, Failed) and event.because is None:
            self._ended(event.task.title, event.sentence)
        self._update()

    def tell_what_was(self) -> None:
        """How many tasks were found done, once."""
        if self._before:
            self._line(f"{self._before} of {counted(self._remaining.total, 'task')} done before")
            self._before = 0
            self._update()

    def _update(self) -> None:
        self._bar.update(self._task, completed=self._remaining.share, state=self._state())

    def _ended(self, title: str, sentence: str) -> None:
        line = f"{self._remaining.done}/{self._remaining.total}  {title}: {sentence}"
        left = self._remaining.seconds()
        if not console.is_terminal and left:  # where there is no bar
            line += f"  (about {words_of(left)} left)"
        self._line(line)

    def _line(self, text: str) -> None:
        console.print(text, highlight=False, soft_wrap=True)

    def _state(self) -> str:
        left = self._remaining.seconds()
        done = f"{self._remaining.done} of {self._remaining.total} done"
        return done if left is None else f"{done}, about {words_of(left)} left"


@contextmanager
def stage_listener() -> Iterator[StageBars]:
    columns = (TextColumn("{task.description:>10}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    more = (TextColumn("left"), TimeRemainingColumn(), TextColumn("{task.fields[state]}"))
    with Progress(*columns, *more, console=console, disable=not console.is_terminal) as bar:
        yield StageBars(bar)


class StageBars:
    """Listens to the events of tasks that follow one another, whose settings have a line `about`: a line as each
    begins, and a bar while it goes on."""

    def __init__(self, bar: Progress) -> None:
        self._bar = bar
        self._last_log_time = time.monotonic()
        self._tasks: dict[str, tuple[TaskID, list[float]]] = {}

    def __call__(self, event: Event) -> None:
        name = event.task.name
        if isinstance(event, Started):
            self._begin(name, event.task.settings.about)
        elif isinstance(event, Finished) and event.before:
            took = "" if event.kept.seconds is None else f" ({event.kept.seconds:.0f} s)"
            self._begin(name, f"done before{took}")
        elif isinstance(event, Advanced):
            self._advance(name, event)
        elif isinstance(event, Said):
            console.print(event.text, highlight=False)

    def _begin(self, name: str, text: str) -> None:
        console.print(f"[bold]{name}[/bold]: {escape(text)}", highlight=False, markup=True)

    def _advance(self, name: str, event: Advanced) -> None:
        if name not in self._tasks:
            self._tasks[name] = (self._bar.add_task(name, total=event.total, state=""), [])
        task, recent = self._tasks[name]
        state = ""
        if "psnr_db" in event.facts:
            recent.append(event.facts["psnr_db"])
            del recent[:-5]  # of one picture each
            mean = sum(recent) / len(recent)
            state = f"loss {event.facts['loss']:.4f}  psnr {mean:.1f} dB  {event.facts['units']:.0f} anchors"
        self._bar.update(task, completed=event.done, total=event.total, state=state)
        now = time.monotonic()
        if not console.is_terminal and (
            event.done == event.total or now - self._last_log_time >= SECONDS_BETWEEN_LINES
        ):
            self._last_log_time = now
            console.print(f"{name} {event.done:g}/{event.total:g}  {state}".rstrip(), highlight=False, soft_wrap=True)


def words_of(seconds: float) -> str:
    """A time to two places."""
    if seconds < 60:
        return f"{seconds:.0f} s" if seconds >= 10 else f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"


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
