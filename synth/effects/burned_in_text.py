"""Text that the recorder burns into the picture: seconds and height of the flight, white on a black box.

The box hides what the lens saw. Where it lies is written to left_out/all.png.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from synth.camera import invert_rigid
from synth.checking import key

STAGE = "film"
COST = "a small rectangle"
TRUTH = "none; left_out/all.png covers the text"

ROWS, COLUMNS = 5, 3  # dots of a character, in a cell with a dot of space around it
FONT = "75557262277174771717557117471774757711227575775717000020070000000"
DOTS = {c: FONT[ROWS * i : ROWS * (i + 1)] for i, c in enumerate("0123456789.- ")}  # rows from the top, octal
CHARACTERS = 13  # "sss.s mmmm.mm"


@dataclass(frozen=True, kw_only=True)
class Settings:
    height_share: float = key("of the box, as a share of the picture's; 0: none", range=(0, 0.5), default=0.06)
    held_out: bool = key("held-out frames show it too; without, they can be compared to the whole scene", default=True)


def expose(settings: Settings, linear: NDArray[np.float32], shot: Any) -> NDArray[np.float32]:
    if shot.frame.split == "test" and not settings.held_out:
        return linear
    position = invert_rigid(shot.frame.viewmat)[:3, 3]
    box = _box(settings.height_share, linear.shape[:2])
    burned = linear.copy()
    burned[box] = _dots(f"{shot.frame.time_s:5.1f} {position[2]:7.2f}", burned[box].shape[:2])[..., None]
    return burned


def covers(settings: Settings, plan: Any) -> NDArray[np.bool_]:
    """Pixels [H, W] of the box."""
    camera = plan.scene.camera
    mask = np.zeros((camera.height_px, camera.width_px), bool)
    mask[_box(settings.height_share, mask.shape)] = True
    return mask


def _dot_px(rows: int) -> int:
    """A dot's side in a box that is so many pixels high."""
    return max(1, rows // (ROWS + 2))


def _box(share: float, size: tuple[int, ...]) -> tuple[slice, slice]:
    """Rows and columns of the box, in the lower left corner of a picture of `size` (height, width)."""
    rows = round(share * size[0])
    columns = min(size[1], (CHARACTERS * (COLUMNS + 1) + 1) * _dot_px(rows)) if rows else 0
    return slice(size[0] - rows, size[0]), slice(0, columns)


def _dots(text: str, size: tuple[int, ...]) -> NDArray[np.float32]:
    """The text in a box of `size` (rows, columns), cut at its edges: 1 where a dot is white."""
    lines = [[bits for c in text for bits in f"0{int(DOTS[c][row]):03b}"] + ["0"] for row in range(ROWS)]
    blank = [["0"] * len(lines[0])]
    dots = np.array([*blank, *lines, *blank], np.float32).repeat(_dot_px(size[0]), 0).repeat(_dot_px(size[0]), 1)
    box = np.zeros(size, np.float32)
    box[: dots.shape[0], : dots.shape[1]] = dots[: size[0], : size[1]]
    return box
