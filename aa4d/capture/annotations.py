"""Boxes of vehicles and people: VisDrone's and UAVDT's annotation files.

VisDrone's toolkits and UAVDT's own files are described in docs/capture.md. Frames count from 1 in both.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aa4d.errors import InputError

MAX_OUTSIDE_FRACTION = 0.02  # fraction of the boxes: genuine ones reach over the edge, their middles do not
MAX_NUMBER = 1e6  # size of a frame number or a pixel: no video has more, and beyond 2^63 numbers turn into others
IGNORED = "_gt_ignore"  # name ending of UAVDT's files of regions in which nobody has looked for vehicles
VISDRONE_IGNORED = 0  # category: a region that nobody has annotated
NO_TARGET = -1  # target of a box that nobody has followed over the frames
UNKNOWN = ""
ONE_BOX = "one box a frame"  # layout
UAVDT_CATEGORIES = {1: "car", 2: "truck", 3: "bus"}  # in files `_gt_whole`; `_gt` has another number in that column
VISDRONE_CATEGORIES = {
    1: "pedestrian",
    2: "people",
    3: "bicycle",
    4: "car",
    5: "van",
    6: "truck",
    7: "tricycle",
    8: "awning-tricycle",
    9: "bus",
    10: "motor",
    11: "others",
}


@dataclass(frozen=True)
class Annotations:
    """Boxes in pixels of the source: left, top, width, height."""

    file: Path
    layout: str
    boxes: dict[int, NDArray[np.float64]]  # frame number -> [M, 4]
    targets: dict[int, NDArray[np.int64]]  # frame number -> [M], one number for one object over all frames, or -1
    categories: dict[int, NDArray[np.str_]]  # frame number -> [M], "" where the file does not say
    empty: int = 0  # rows left out: boxes without width or height, as some data sets mark an absent target

    def check_size(self, width: int, height: int) -> None:
        """Raises InputError where the boxes are of larger pictures than the sequence has."""
        every = np.concatenate([*self.boxes.values(), np.zeros((0, 4))])
        middle = every[:, :2] + every[:, 2:] / 2
        outside = int(((middle < 0) | (middle > [width, height])).any(axis=1).sum())
        if outside > MAX_OUTSIDE_FRACTION * len(every):
            raise InputError(
                f"{self.file}: {outside} of {len(every)} boxes lie outside of the frames, which are {width}x{height}: "
                "give the annotations of this sequence, and its frames at their own size"
            )

    def of(self, number: int | None) -> NDArray[np.float64]:
        return self.boxes.get(-1 if number is None else number, np.zeros((0, 4)))

    @property
    def follows(self) -> bool:
        """True where the movers are known again from frame to frame; a file of one box a frame follows one of many."""
        return self.layout != ONE_BOX and any((target != NO_TARGET).any() for target in self.targets.values())


def read_annotations(path: Path, numbers: list[int] | None) -> Annotations:
    """Read a file by its number of columns: 10 VisDrone, 9 UAVDT (rows by target, not by frame), 4 one box a frame.

    Args:
        numbers: of the frames, as their file names have them.

    Raises:
        InputError: another layout, a damaged row, no frame in common, or frames without numbers.
    """
    if path.stem.endswith(IGNORED):
        vehicles = path.name.replace(IGNORED, "_gt_whole")
        raise InputError(f"{path}: holds regions to be ignored, not movers; give the file of vehicles ({vehicles})")
    if numbers is None:
        raise InputError(f"{path}: boxes go by frame number, and the frames' file names have none; rename the frames")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); give the annotation file") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: is no text; give the annotation file") from None
    rows: list[list[float]] = []
    for line_number, line in enumerate(text.splitlines(), 1):
        if not line.strip():
            continue
        try:
            rows.append([float(value) for value in line.strip().rstrip(",").split(",")])
        except ValueError:
            raise InputError(f"{path}: line {line_number} is not a row of numbers: {line[:60]!r}; restore it") from None
        if len(rows[-1]) != len(rows[0]):
            raise InputError(
                f"{path}: line {line_number} has another number of columns than the first; restore the file"
            )
        if not (np.abs(rows[-1]) < MAX_NUMBER).all():
            raise InputError(f"{path}: line {line_number} holds no frame or pixel: {line[:60]!r}; restore the file")
        if any(side < 0 for side in _box(rows[-1])[2:]):
            raise InputError(f"{path}: line {line_number} is a box of negative size: {line[:60]!r}; restore the file")
    if not rows:
        return Annotations(path, "empty", {}, {}, {})
    table = np.array(rows)
    if table.shape[1] not in (10, 9, 4):
        raise InputError(
            f"{path}: rows have {table.shape[1]} columns; known are 10 (VisDrone), 9 (UAVDT) and 4 (one box a frame): "
            "give a file of one of these kinds, or no --annotations"
        )
    frame = table[:, 0]
    target, wanted = table[:, 1], np.ones(len(table), bool)
    names: dict[int, str] = {}
    if table.shape[1] == 10:
        layout, wanted = "VisDrone", table[:, 7] != VISDRONE_IGNORED
        category, names = table[:, 7], VISDRONE_CATEGORIES
    elif table.shape[1] == 9:
        layout, category = "UAVDT", table[:, 8]
        names = UAVDT_CATEGORIES if (category > 0).all() else {}
    else:
        layout, frame = ONE_BOX, np.arange(1.0, len(table) + 1)
        target, category = np.ones(len(table)), np.zeros(len(table))  # one object is followed
    every = table[:, 2:6] if table.shape[1] > 4 else table
    sized = (every[:, 2:] > 0).all(axis=1)
    kept = wanted & sized
    named = np.array([names.get(int(number), UNKNOWN) for number in category[kept]], np.str_)
    boxes = _by_frame(frame[kept], every[kept])
    if boxes and not boxes.keys() & set(numbers):
        raise InputError(
            f"{path}: its boxes are of frames {min(boxes)} to {max(boxes)}, and the input's frames are numbered "
            f"{min(numbers)} to {max(numbers)}: give this sequence's own with --annotations"
        )
    targets = _by_frame(frame[kept], np.maximum(target[kept], NO_TARGET).astype(np.int64))
    return Annotations(path, layout, boxes, targets, _by_frame(frame[kept], named), int((wanted & ~sized).sum()))


def _box(row: list[float]) -> list[float]:
    """Left, top, width and height: the third to the sixth column, where there are more than those."""
    return row[2:6] if len(row) > 4 else row


def _by_frame(frame: NDArray[np.float64], values: NDArray[Any]) -> dict[int, NDArray[Any]]:
    frame = frame.astype(int)
    return {int(number): values[frame == number] for number in np.unique(frame)}
