"""Engines: where tasks are done. One module and one entry each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Protocol

from aa4d.errors import InputError
from aa4d.graph.events import Tell
from aa4d.graph.task import Task
from aa4d.graph.work import Job

# The module of each, which has a function `engine`; imported when it is asked for.
ENGINES: Mapping[str, str] = {
    "inline": "aa4d.graph.engines.inline",
    "processes": "aa4d.graph.engines.processes",
    "ray": "aa4d.graph.engines.ray",
}
DEFAULT = "processes"
CLUSTERS = ("ray",)  # engines that work on a cluster, which has an address


@dataclass(frozen=True)
class Means:
    """What an engine is given to work with."""

    jobs: int | None = None  # tasks at a time; None: as the engine likes
    address: str | None = None  # of a cluster


class Engine(Protocol):
    """Does jobs, and tells what happens to them, from the thread that calls it."""

    slots: int  # jobs that it does at a time, for estimates

    def has_room(self, task: Task) -> bool: ...

    def start(self, job: Job, tell: Tell) -> None:
        """Do a job, now or beside others."""

    def wait(self) -> None:
        """Return once something has been told, or after a second."""

    def stop(self) -> None:
        """Let all jobs save and end, and tell so."""

    def close(self) -> None:
        """Leave nothing behind."""


def check_means(name: str, means: Means) -> None:
    """Raises InputError for an address, or tasks at a time, that the engine has no use for."""
    if means.address is not None and name not in CLUSTERS:
        raise InputError(
            f"--address {means.address}: is of a Ray cluster, and the engine {name} uses none; "
            "add --engine ray, or leave it out"
        )
    if name == "inline" and means.jobs not in (None, 1):
        raise InputError(f"--jobs {means.jobs}: the engine inline does one task at a time; choose --engine processes")


def engine_of(name: str, means: Means) -> Engine:
    """Raises InputError where the engine cannot work: a package or a cluster is not there; and see `check_means`."""
    check_means(name, means)
    made: Engine = import_module(ENGINES[name]).engine(means)
    return made
