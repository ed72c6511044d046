"""What happens to the tasks of a graph, as typed events: consoles, logs and viewers hear the same."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from aa4d.graph.kinds import Kept
from aa4d.graph.task import Task


@dataclass(frozen=True)
class Started:
    task: Task


@dataclass(frozen=True)
class Advanced:
    """Some of a task is done; `facts` are numbers of that moment, such as a loss."""

    task: Task
    done: float
    total: float
    facts: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Said:
    """A sentence for whoever looks on."""

    task: Task
    text: str


@dataclass(frozen=True)
class Finished:
    task: Task
    kept: Kept
    before: bool = False  # it was there already


@dataclass(frozen=True)
class Failed:
    task: Task
    sentence: str
    because: Task | None = None  # the task that it needed and that failed; then it was not tried


@dataclass(frozen=True)
class Stopped:
    """It was asked to stop, and has saved what it had."""

    task: Task


Event = Started | Advanced | Said | Finished | Failed | Stopped
Tell = Callable[[Event], None]
