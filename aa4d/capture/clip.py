"""The clip: the frames that are used, in presentation order, as files of one size in one folder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from aa4d.capture.workspace import StepResult


@dataclass(frozen=True)
class Position:
    """Position of the camera, by satellite: degrees, and metres above any one level."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float


@dataclass(frozen=True)
class Picture:
    """One frame of a source, not yet read."""

    label: str  # what people call it: a file name, or the second of a video
    time_s: float
    number: int | None  # its name in annotation files
    load: Callable[[], NDArray[np.uint8]]  # [H, W, 3] sRGB, upright; raises InputError
    original: Path | None = None  # a file that holds exactly these pixels, JPEG or PNG
    position: Position | None = None


@dataclass(frozen=True)
class ClipFrame:
    file: str  # name in the clip's folder
    label: str
    time_s: float
    number: int | None
    sharpness: float
    position: Position | None


@dataclass(frozen=True)
class Clip(StepResult):
    width: int
    height: int
    source_size: tuple[int, int]  # width and height in the source, which annotations count in
    frames: tuple[ClipFrame, ...]
    notes: tuple[str, ...]  # what was left out and why

    @classmethod
    def from_json(cls, folder: Path, value: dict[str, Any]) -> Self:
        frames = tuple(
            ClipFrame(**{**f, "position": Position(**f["position"]) if f["position"] else None})
            for f in value["frames"]
        )
        width, height = value["source_size"]
        return cls(folder, value["width"], value["height"], (width, height), frames, tuple(value["notes"]))
