"""Kinds of tasks: one module and one entry each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from aa4d.graph.call import Call
    from aa4d.graph.task import Task

# The module of each, which has a `KIND` and imports what it works with when it is run: a graph whose tasks are all done
# waits for nothing. A name that is not here is itself a module's.
KINDS: dict[str, str] = {
    "render": "aa4d.experiments.kinds.render",
    "thin": "aa4d.experiments.kinds.thin",
    "train": "aa4d.experiments.kinds.train",
    "evaluate": "aa4d.experiments.kinds.evaluate",
    "trial": "aa4d.experiments.kinds.trial",
    "tabulate": "aa4d.experiments.kinds.tabulate",
    "demo": "aa4d.demo_stages",
    "pose-noise": "aa4d.experiments.pose_noise",
    "track-recall": "aa4d.experiments.track_recall",
    "capture-accuracy": "aa4d.experiments.capture_accuracy",
    "cost": "aa4d.cost.kind",
}


@dataclass(frozen=True)
class Kept:
    """A result that is there."""

    result: dict[str, Any]
    seconds: float | None  # of work, those of interrupted tries included; None where nobody knows
    content: str  # digest of what it holds


@dataclass(frozen=True)
class Kind:
    """How a kind of task is run.

    Args:
        run: fills the call's folder and returns what others want to know of it, a JSON object. What an interrupted run
            has left in the folder is still there.
        version: changes where the same settings make another result.
        kept: for results that keep a record of their own, in the folder that they are made in: the result that is
            there, or None. Raises InputError where the folder holds something that must not be overwritten.
    """

    run: Callable[[Call], dict[str, Any]]
    version: str = "1"
    kept: Callable[[Task, Path], Kept | None] | None = None


def kind_of(name: str) -> Kind:
    kind: Kind = import_module(KINDS.get(name, name)).KIND
    return kind
