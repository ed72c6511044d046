"""What tasks cost: seconds measured before, and what a graph will take by them."""

from __future__ import annotations

import heapq
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from aa4d.graph.store import Store
from aa4d.graph.task import Task


class Costs:
    """Seconds a unit of what has been done, by kind and by what is alike."""

    def __init__(self, stores: Iterable[Store] = ()) -> None:
        self._rates: dict[tuple[str, str], list[float]] = {}
        for store in stores:
            for record in store.records():
                self._add(record["identity"]["kind"], record["alike"], record["seconds"] / record["units"])

    def add(self, task: Task, seconds: float) -> None:
        self._add(task.kind, task.alike, seconds / task.units)

    def _add(self, kind: str, alike: str, rate: float) -> None:
        self._rates.setdefault((kind, alike), []).append(rate)

    def seconds(self, task: Task) -> float | None:
        """By what is alike, else by all of the kind; None where none of it has been measured."""
        rates = self._rates.get((task.kind, task.alike))
        rates = rates or [rate for (kind, _), found in self._rates.items() if kind == task.kind for rate in found]
        return statistics.fmean(rates) * task.units if rates else None


@dataclass(frozen=True)
class Planned:
    task: Task
    state: str  # one of STATES
    seconds: float | None = None  # that it would take; None where that is not known


DONE, EDITED, MISSING = "done", "changed since it was made", "to do"


def plan(tasks: Sequence[Task], store: Store, costs: Costs) -> list[Planned]:
    """What a run would find, in the order of `tasks`, which is that of needs.

    Raises:
        InputError: the place of a result holds something that must not be overwritten.
    """
    contents: dict[str, str] = {}
    found = []
    for task in tasks:
        kept = None
        if all(need.digest in contents for need in task.needs):
            kept = store.kept(task, {need.digest: contents[need.digest] for need in task.needs})
        if kept is not None:
            contents[task.digest] = kept.content
            found.append(Planned(task, DONE))
        else:
            state = MISSING if store.edited(task) is None else EDITED
            found.append(Planned(task, state, costs.seconds(task)))
    return found


def makespan(seconds: Mapping[str, float], tasks: Sequence[Task], slots: int) -> float:
    """Seconds until all is done, `slots` tasks at a time in the order given, which is that of needs.

    Args:
        seconds: of each task by its digest; what is not there is done.
    """
    free = [0.0] * max(slots, 1)
    ends: dict[str, float] = {}
    for task in tasks:
        if task.digest in seconds:
            ready = max((ends.get(need.digest, 0.0) for need in task.needs), default=0.0)
            ends[task.digest] = max(heapq.heappop(free), ready) + seconds[task.digest]
            heapq.heappush(free, ends[task.digest])
    return max(ends.values(), default=0.0)
