"""Runs a graph: what is there stays, what fails stops nothing but what needs it, and the same command continues."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import FrameType

from aa4d.errors import InputError, Interrupted
from aa4d.graph.engines import Engine
from aa4d.graph.events import Event, Failed, Finished, Said, Started, Stopped, Tell
from aa4d.graph.kinds import Kept
from aa4d.graph.store import Store
from aa4d.graph.task import Task, in_order
from aa4d.graph.work import Job
from aa4d.words import counted


@dataclass(frozen=True)
class Outcome:
    """What the tasks of a graph came to, by their digests."""

    kept: dict[str, Kept] = field(default_factory=dict)
    failures: dict[str, Failed] = field(default_factory=dict)


def run_graph(tasks: Sequence[Task], store: Store, engine: Engine, tell: Tell) -> Outcome:
    """Do the tasks and all that they need, those that are named first as early as their needs allow.

    Args:
        tell: hears of every event, in the thread of the caller.

    Raises:
        Interrupted: Ctrl-C; what was running is saved.
        InputError: the place of a result holds something that must not be overwritten.
    """
    run = _Run(in_order(tasks), store, engine, tell)
    try:
        with _terminations_as_interrupts():
            run.all()
    except KeyboardInterrupt:
        engine.stop()
        done = f"{len(run.outcome.kept)} of {counted(len(run.tasks), 'task')}"
        raise Interrupted(f"stopped; {done} done, and the same command continues") from None
    finally:
        engine.close()
    return run.outcome


class _Run:
    def __init__(self, tasks: tuple[Task, ...], store: Store, engine: Engine, tell: Tell) -> None:
        self.tasks, self.outcome = tasks, Outcome()
        self._store, self._engine, self._tell = store, engine, tell
        self._waiting = list(tasks)
        self._missing: set[str] = set()  # looked for, and not there
        self._running: set[str] = set()
        self._stopped = False

    def all(self) -> None:
        for task in list(self._waiting):  # first what is there, so that what cannot go on is refused before it begins
            self._consider(task, start=False)
        while self._waiting or self._running:
            for task in list(self._waiting):
                self._consider(task, start=True)
            if self._running:
                self._engine.wait()
            self._end_if_stopped()

    def _end_if_stopped(self) -> None:
        """A task that was done in this process has answered the signal."""
        if self._stopped:
            raise KeyboardInterrupt

    def _consider(self, task: Task, *, start: bool) -> None:
        """Settle a task that is there or can never be; start another one if its turn has come."""
        kept, failures = self.outcome.kept, self.outcome.failures
        if any(need.digest not in kept and need.digest not in failures for need in task.needs):
            return
        failed = [failures[need.digest] for need in task.needs if need.digest in failures]
        if failed and not task.partial:
            self._waiting.remove(task)
            cause = failed[0].because or failed[0].task
            sentence = failures[cause.digest].sentence
            self._hear(Failed(task, f"not tried, for {cause.title} failed: {sentence}", cause))
            return
        needs = {need.digest: kept[need.digest] for need in task.needs if need.digest in kept}
        # Several jobs of one thread each get more done than one with several.
        threads = task.resources.cores or (1 if self._engine.slots > 1 else None)
        job = Job(self._store.root, task, needs, {f.task.name: f.sentence for f in failed}, threads)
        if task.digest not in self._missing:
            if (there := self._store.kept(task, job.contents)) is not None:
                self._waiting.remove(task)
                self._hear(Finished(task, there, before=True))
                return
            self._missing.add(task.digest)
            if (edited := self._store.edited(task)) is not None:
                self._tell(Said(task, f"{edited} is not as it was made; {task.title} is made again"))
        if start and self._engine.has_room(task):
            self._waiting.remove(task)
            self._running.add(task.digest)
            self._tell(Started(task))
            self._engine.start(job, self._hear)
            self._end_if_stopped()

    def _hear(self, event: Event) -> None:
        if isinstance(event, Finished):
            self.outcome.kept[event.task.digest] = event.kept
        elif isinstance(event, Failed):
            self.outcome.failures[event.task.digest] = event
        if isinstance(event, Finished | Failed | Stopped):
            self._running.discard(event.task.digest)
            self._stopped |= isinstance(event, Stopped)
        self._tell(event)


@contextmanager
def _terminations_as_interrupts() -> Iterator[None]:
    """A batch system's request to stop is answered like Ctrl-C."""
    if threading.current_thread() is not threading.main_thread():  # elsewhere signals belong to somebody else
        yield
        return

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def check(outcome: Outcome) -> None:
    """Raises InputError where something failed; all others were done."""
    tried = [failed for failed in outcome.failures.values() if failed.because is None]
    if tried:
        skipped = len(outcome.failures) - len(tried)
        also = f", {skipped} that need them were not tried" if skipped else ""
        total = counted(len(outcome.failures) + len(outcome.kept), "task")
        raise InputError(
            f"{len(tried)} of {total} failed{also}; first: {tried[0].task.title}: {tried[0].sentence}; "
            "the same command tries again"
        )
