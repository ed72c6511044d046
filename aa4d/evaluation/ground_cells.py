"""The ground of a capture with truth, in cells that know when something drives over them (docs/truth.md)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aa4d.capture.reader import Capture
from aa4d.capture.truth import read_array
from aa4d.errors import InputError
from aa4d.evaluation.activity import CLASSES

ACTIVITY = "truth/activity.npz"
MOVING = tuple(CLASSES.index(name) for name in ("intermittent", "persistent"))

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GroundCells:
    """Square cells of z = 0, R rows along y and C columns along x, at the capture's N frames."""

    active: NDArray[np.bool_]  # [N, R, C] something moves over the cell
    label: NDArray[np.uint8]  # [R, C] of CLASSES, over the clip
    origin_m: Array  # [2] corner of the first
    side_m: float

    def below(self, places: Array) -> NDArray[np.int64]:
        """Flat index [...] of the cell below, or above, world points [..., 3]; -1 outside and for NaN."""
        rows, columns = self.label.shape
        cell = np.floor((places[..., :2] - self.origin_m) / self.side_m)
        inside = ((cell >= 0) & (cell < (columns, rows))).all(axis=-1)
        column, row = np.moveaxis(np.where(inside[..., None], cell, 0).astype(np.int64), -1, 0)
        return np.where(inside, row * columns + column, -1)


def ground_cells(capture: Capture) -> GroundCells | None:
    """None where the capture has no truth of activity. Raises InputError for a damaged one."""
    path = capture.folder / ACTIVITY
    if not path.is_file():
        return None
    active, label, origin, side = (
        read_array(path, name) for name in ("cell_active", "cell_label", "origin_m", "cell_m")
    )
    fits = active.ndim == 3 and label.shape == active.shape[1:] and origin.shape == (2,) and side.shape == ()
    if not fits or len(active) != len(capture.frames) or not (np.isfinite(origin).all() and 0 < side < np.inf):
        raise InputError(f"{path}: its arrays do not fit together, or the capture; make the capture again")
    return GroundCells(active.astype(bool), label, origin, float(side))
