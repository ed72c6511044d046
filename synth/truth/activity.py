"""Which parts of a scene are active when: labels, ground cells, and two indices of heterogeneity (docs/truth.md)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LABELS = ("static", "intermittent", "persistent", "appearance-only", "unseen")
STATIC, INTERMITTENT, PERSISTENT, APPEARANCE_ONLY, UNSEEN = range(5)
PERSISTENT_SHARE = 0.9  # active for at least this share of the time
SAMPLE_S = 0.1  # activity is looked up this often, whatever the frame rate


def sample_times(frames_s: Array) -> Array:
    """The frames' instants [N], and evenly spaced times between two of them, at most `SAMPLE_S` apart: what is said
    of the clip and what is said of its frames are looked up at the same times."""
    if len(frames_s) < 2:
        return np.array(frames_s, dtype=np.float64)
    between = max(1, int(np.ceil(np.diff(frames_s).max() / SAMPLE_S - 1e-9)))
    shares = np.arange(between) / between
    inner = frames_s[:-1, None] + shares * np.diff(frames_s)[:, None]
    return np.append(inner.ravel(), frames_s[-1])


def label_of(active: Mask, changes: Mask, there: Mask | None = None) -> NDArray[np.uint8]:
    """Labels [S] of subjects from their activity over time.

    `active` [T, S]: it moves. `changes` [S]: its look changes without motion. `there` [T, S]: the times that count
    (all of them by default).
    """
    counted = np.ones_like(active) if there is None else there
    share = (active & counted).sum(axis=0) / np.maximum(counted.sum(axis=0), 1)
    labels = np.where(share >= PERSISTENT_SHARE, PERSISTENT, INTERMITTENT)
    labels = np.where(share == 0, np.where(changes, APPEARANCE_ONLY, STATIC), labels)
    return labels.astype(np.uint8)


def intervals(times_s: Array, active: Mask, end_s: float) -> list[tuple[float, float]]:
    """When a subject [T] is active: [start, end) of every run; one that lasts to the last time ends at `end_s`, when
    the clip is over, so that it holds the last frame too."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], active, [False]]).astype(np.int8)))
    ends = np.append(times_s, end_s)
    return [(float(times_s[a]), float(ends[b])) for a, b in edges.reshape(-1, 2)]


def within(intervals_s: Array, times_s: Array) -> Mask:
    """Which times [T] lie in any of the intervals [I, 2], [start, end)."""
    return ((intervals_s[:, 0] <= times_s[:, None]) & (times_s[:, None] < intervals_s[:, 1])).any(axis=1)


@dataclass(frozen=True)
class Grid:
    """Square cells of the ground, z = 0: `origin_m` is the corner of the first."""

    origin_m: tuple[float, float]
    cell_m: float
    shape: tuple[int, int]  # rows along y, columns along x

    def cell_of(self, points: Array) -> NDArray[np.int64]:
        """Flat index [...] of the cell under (or over) points [..., 2 or more]; -1 outside and for NaN."""
        with np.errstate(invalid="ignore"):
            at = np.floor((points[..., :2] - self.origin_m) / self.cell_m)
            inside = ((at >= 0) & (at < self.shape[::-1])).all(axis=-1)
        at = np.where(inside[..., None], at, 0).astype(np.int64)
        return np.where(inside, at[..., 1] * self.shape[1] + at[..., 0], -1)

    def centres(self) -> Array:
        """[R, C, 3] on the ground."""
        rows, columns = self.shape
        x = self.origin_m[0] + (np.arange(columns) + 0.5) * self.cell_m
        y = self.origin_m[1] + (np.arange(rows) + 0.5) * self.cell_m
        return np.stack([*np.meshgrid(x, y), np.zeros(self.shape)], axis=-1)


def grid_around(points: Array, cell_m: float) -> Grid:
    """The cells that cover points [..., 3]; NaN is ignored."""
    flat = points.reshape(-1, points.shape[-1])[:, :2]
    flat = flat[np.isfinite(flat).all(axis=1)]
    if not len(flat):
        return Grid((0.0, 0.0), cell_m, (1, 1))
    low = np.floor(flat.min(axis=0) / cell_m)
    columns, rows = (np.floor(flat.max(axis=0) / cell_m) - low + 1).astype(int)
    return Grid((float(low[0] * cell_m), float(low[1] * cell_m)), cell_m, (int(rows), int(columns)))


def footprints(grid: Grid, object_to_world: Array, dimensions_m: Array, chosen: Mask) -> Mask:
    """Cells [R, C] that the footprint of a chosen instance [M] touches with a point of a fine lattice."""
    touched = np.zeros(grid.shape[0] * grid.shape[1], dtype=bool)
    for pose, size in zip(object_to_world[chosen], dimensions_m[chosen], strict=True):
        steps = [np.linspace(-0.5, 0.5, int(np.ceil(2 * side / grid.cell_m)) + 1) * side for side in size[:2]]
        x, y = np.meshgrid(*steps)
        lattice = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=-1) @ pose[:3, :3].T + pose[:3, 3]
        cells = grid.cell_of(lattice)
        touched[cells[cells >= 0]] = True
    return touched.reshape(grid.shape)


def heterogeneity_in_space(labels: NDArray[np.uint8]) -> float:
    """Entropy of the shares of the four labels among the seen cells, over its greatest value log 4: 0 to 1."""
    counted = np.bincount(labels[labels != UNSEEN].ravel(), minlength=4)[:4]
    if not counted.sum():
        return 0.0
    share = counted[counted > 0] / counted.sum()
    return float(max(0.0, -(share * np.log(share)).sum()) / np.log(4))


def active_share(active: Mask) -> float:
    """Of the cells [T, ...], those that are ever active."""
    ever = active.reshape(len(active), -1).any(axis=0)
    return float(ever.mean()) if len(ever) else 0.0


def changes_per_second(active: Mask, duration_s: float) -> float:
    """How often a cell [T, ...] that is ever active begins or ends to be so, in the mean over those cells."""
    flat = active.reshape(len(active), -1)
    ever = flat[:, flat.any(axis=0)]
    if duration_s <= 0 or not ever.size:
        return 0.0
    return float((ever[1:] != ever[:-1]).sum(axis=0).mean() / duration_s)


def heterogeneity_in_time(active: Mask) -> float:
    """Mean of 4 a (1 - a) over the cells that are ever active, a being the share of the time [T, ...] in which the
    cell is: 0 where every active cell is so all the time, 1 where each is half the time."""
    share = active.reshape(len(active), -1).mean(axis=0)
    ever = share[share > 0]
    return float((4 * ever * (1 - ever)).mean()) if len(ever) else 0.0
