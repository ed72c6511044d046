"""The initial point cloud: what structure from motion would find, taken from the depth of the training frames."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from synth.camera import pixel_centres
from synth.lens import Lens
from synth.plan import Frame, Plan

Array = NDArray[np.float64]

TARGET_POINTS = 10_000
PIXEL_STRIDE = 3
DEPTH_AGREEMENT = 0.003  # relative: nearer than this to the depth of a frame, a point is seen in it
FARTHEST_M = 200.0


@dataclass(frozen=True)
class View:
    """What one training frame contributes: colours [H, W, 3] 8-bit sRGB, planar depth [H, W] in metres and which
    pixels are fixed [H, W]: hit something, that did not move at that instant."""

    frame: Frame
    colours: NDArray[np.uint8]
    depth_z: NDArray[np.float32]
    fixed: NDArray[np.bool_]


@dataclass(frozen=True)
class PointCloud:
    """Points with colours, and the track of each: in which frame it is seen at which pixel position."""

    positions: Array  # [P, 3]
    colours: NDArray[np.uint8]  # [P, 3]
    point_of: NDArray[np.int64]  # [O] index of the point of every observation
    rank_of: NDArray[np.int64]  # [O] rank of the frame
    pixels: Array  # [O, 2]


def load_views(plan: Plan, read_image: Callable[[Frame], NDArray[np.uint8]],
               read_truth: Callable[[Frame], dict[str, NDArray]]) -> list[View]:  # fmt: skip
    """The training frames of a rendered plan; where there are none, of one frame or a second drone, all."""
    views = []
    for frame in [frame for frame in plan.frames if frame.split == "train"] or plan.frames:
        truth = read_truth(frame)
        depth, ids = truth["depth_z"], truth["instance_id"]
        moves = np.concatenate([[False], plan.cast.moving(frame.time_s)])  # by id; 0 is the background
        views.append(View(frame, read_image(frame), depth, (depth < FARTHEST_M) & ~moves[ids]))
    return views


def build_points(views: list[View], lens: Lens) -> PointCloud:
    """About `TARGET_POINTS` surface points, evenly spread by a voxel grid, coloured by the mean over their views."""
    candidates = np.concatenate([_surface(view, lens) for view in views])
    positions = _thin(candidates, TARGET_POINTS)
    sums, counts = np.zeros((len(positions), 3)), np.zeros(len(positions), dtype=np.int64)
    points, ranks, pixels = [], [], []
    for view in views:
        local = positions @ view.frame.viewmat[:3, :3].T + view.frame.viewmat[:3, 3]
        uv, depth = lens.project(local), local[:, 2]
        height, width = view.depth_z.shape
        inside = (depth > 0) & (uv[:, 0] >= 0) & (uv[:, 0] < width) & (uv[:, 1] >= 0) & (uv[:, 1] < height)
        index = np.flatnonzero(inside)
        column, row = uv[index].astype(np.int64).T
        near = np.abs(view.depth_z[row, column] / depth[index] - 1) < _tolerance(view)[row, column]
        seen = near & view.fixed[row, column]
        index, column, row = index[seen], column[seen], row[seen]
        sums[index] += view.colours[row, column]
        counts[index] += 1
        points.append(index)
        ranks.append(np.full(len(index), view.frame.rank))
        pixels.append(uv[index])
    found = counts > 0
    renumber = np.cumsum(found) - 1
    colours = np.round(sums[found] / counts[found, None]).astype(np.uint8)
    return PointCloud(
        positions[found], colours, renumber[np.concatenate(points)], np.concatenate(ranks), np.concatenate(pixels)
    )


def _surface(view: View, lens: Lens) -> Array:
    """World points of every few pixels of what is fixed in a view."""
    height, width = view.depth_z.shape
    grid = np.zeros((height, width), dtype=bool)
    grid[PIXEL_STRIDE // 2 :: PIXEL_STRIDE, PIXEL_STRIDE // 2 :: PIXEL_STRIDE] = True
    chosen = grid & view.fixed
    local = lens.rays(pixel_centres(width, height)[chosen]) * view.depth_z[chosen].astype(np.float64)[:, None]
    return (local - view.frame.viewmat[:3, 3]) @ view.frame.viewmat[:3, :3]


def _tolerance(view: View) -> Array:
    """How far depth may differ within half a pixel of a surface that is seen at a slant: from its own slope."""
    depth = np.where(np.isfinite(view.depth_z), view.depth_z, 1e6).astype(np.float64)
    steps = [np.abs(np.diff(depth, axis=axis)) for axis in (0, 1)]
    slope = np.minimum(np.pad(steps[0], ((0, 1), (0, 0)), mode="edge"), np.pad(steps[0], ((1, 0), (0, 0)), mode="edge"))
    slope += np.minimum(
        np.pad(steps[1], ((0, 0), (0, 1)), mode="edge"), np.pad(steps[1], ((0, 0), (1, 0)), mode="edge")
    )
    return DEPTH_AGREEMENT + np.minimum(slope / depth, 0.02)


def _thin(points: Array, target: int) -> Array:
    """One point per voxel, the voxel's size chosen by bisection for `target` points."""
    if len(points) <= target:
        return points
    low, high = 1e-3, 50.0  # metres
    for _ in range(24):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if len(_first_per_voxel(points, middle)) > target else (low, middle)
    return points[_first_per_voxel(points, high)]


def _first_per_voxel(points: Array, size: float) -> NDArray[np.int64]:
    cells = np.floor(points / size).astype(np.int64) + 2**20
    keys = (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]
    return np.sort(np.unique(keys, return_index=True)[1])
