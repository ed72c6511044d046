"""How long a running graph will still take: by what has been measured, before and in this run."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from aa4d.graph.costs import Costs, makespan
from aa4d.graph.events import Advanced, Event, Failed, Finished, Started
from aa4d.graph.task import Task

ENOUGH = 0.02  # of a task, after which its pace tells how long it will take


class Remaining:
    """Listens to the events of a graph.

    A running task is timed by its own pace. One of a kind of which nothing has been measured counts for nothing.
    """

    def __init__(
        self, tasks: Sequence[Task], costs: Costs, slots: int, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._tasks, self._costs, self._slots, self._clock = tasks, costs, slots, clock
        self._open = {task.digest: task for task in tasks}
        self._started: dict[str, float] = {}
        self._share: dict[str, tuple[float, float]] = {}  # when it was last heard of, and how much was done
        self._first: dict[str, tuple[float, float]] = {}  # likewise, first: a continued task begins in the middle

    def __call__(self, event: Event) -> None:
        digest = event.task.digest
        if isinstance(event, Started):
            self._started[digest] = self._clock()
        elif isinstance(event, Advanced) and event.total > 0:
            self._share[digest] = (self._clock(), event.done / event.total)
            self._first.setdefault(digest, self._share[digest])
        elif isinstance(event, Finished | Failed):
            self._open.pop(digest, None)
            if isinstance(event, Finished) and not event.before and event.kept.seconds is not None:
                self._costs.add(event.task, event.kept.seconds)

    @property
    def total(self) -> int:
        return len(self._tasks)

    @property
    def done(self) -> int:
        return len(self._tasks) - len(self._open)

    @property
    def share(self) -> float:
        """Of the work, by the seconds that it takes; by the number of tasks where nothing is known of them."""
        known = {task.digest: self._costs.seconds(task) for task in self._tasks}
        measured = [seconds for seconds in known.values() if seconds is not None]
        mean = sum(measured) / len(measured) if measured else 1.0
        weight = {digest: mean if seconds is None else seconds for digest, seconds in known.items()}
        left = sum(weight[digest] * (1 - self._share.get(digest, (0.0, 0.0))[1]) for digest in self._open)
        whole = sum(weight.values())
        return 1 - left / whole if whole else 1.0

    def seconds(self) -> float | None:
        """None while nothing is known of what is left."""
        left = {digest: known for digest in self._open if (known := self._left(digest)) is not None}
        if self._open and not left:
            return None
        return makespan(left, self._tasks, self._slots)

    def _left(self, digest: str) -> float | None:
        now = self._clock()
        if digest in self._share:
            (since, before), (at, share) = self._first[digest], self._share[digest]
            if share - before >= ENOUGH:
                pace = (at - since) / (share - before)
                return max(pace * (1 - share) - (now - at), 0.0)
        known = self._costs.seconds(self._open[digest])
        if known is None:
            return self._by_pace_of_others(self._open[digest])
        return max(known - (now - self._started.get(digest, now)), 0.0)

    def _by_pace_of_others(self, task: Task) -> float | None:
        """Seconds of a task when its kind runs for the first time."""
        for digest, (at, share) in self._share.items():
            other = self._open.get(digest)
            since, before = self._first[digest]
            if other is not None and other.kind == task.kind and share - before >= ENOUGH:
                return (at - since) / (share - before) / other.units * task.units
        return None
