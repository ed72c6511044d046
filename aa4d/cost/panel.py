"""Panels: what is varied, how quality and time are measured, and which point is the default."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from aa4d.graph.task import Task


@dataclass(frozen=True)
class Size:
    """How much is measured."""

    name: str
    scene: str  # file of the repository that is rendered, where no capture is given
    small_scene: str  # likewise, for what is rendered again and again
    schedule: tuple[int, int]  # coarse and fine iterations of a training that varies something else
    share: float  # of the capture's width and height, in trainings that vary something else
    repeats: int  # of what takes milliseconds; the least counts


SIZES = {
    "quick": Size("quick", "scenes/cost/quick.toml", "scenes/tiny.toml", (100, 375), 0.5, 5),
    "full": Size("full", "scenes/crossroads.toml", "scenes/crossroads.toml", (800, 3000), 1.0, 15),
}


@dataclass(frozen=True)
class Setup:
    """What panels are measured on."""

    size: Size
    capture: Path | None = None  # to train on and to reconstruct; None: one that is rendered


@dataclass(frozen=True)
class Quality:
    """A panel's vertical axis."""

    name: str
    unit: str
    better: int  # 1 the higher, -1 the lower
    is_log: bool = False

    @property
    def label(self) -> str:
        return f"{self.name}, {self.unit}" if self.unit else self.name


@dataclass(frozen=True)
class Point:
    """One choice, and what it costs and gives."""

    label: str
    processor_s: float  # of all threads
    wall_s: float | None  # None where it was not measured
    quality: float | None  # None where the choice came to nothing that can be compared
    is_default: bool = False
    series: str = ""  # points of one series are joined by a line
    more: dict[str, float | str | None] = field(default_factory=dict)  # further columns of the table


@dataclass(frozen=True)
class Measurement:
    """A task, and the points that its result, a JSON object, gives to a panel."""

    task: Task
    points: Callable[[dict[str, Any]], list[Point]]


def nothing_missing(_setup: Setup) -> str | None:
    return None


@dataclass(frozen=True)
class Panel:
    title: str
    varied: str  # what is varied and what the default is, in a sentence
    measured: str  # on what, and how quality and time are measured
    per: str  # what the seconds are of: "a frame"
    quality: Quality | None  # None: what is varied has no common measure, and only the time is shown
    measurements: Callable[[Setup], tuple[Measurement, ...]]
    missing: Callable[[Setup], str | None] = nothing_missing  # what it lacks here, in words; None: nothing
    across: str | None = None  # the column of `Point.more` that quality costs here; None: seconds of the processor
