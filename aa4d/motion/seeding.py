"""Where the anchors of a mover start: voxels of its own frame that the frames agree it fills.

A voxel is kept where most of the frames that show the mover have it inside of its outline (a visual hull, Laurentini
1994, by votes, since outlines are found and may be wrong in some). No depth is asked for: what a static model knows of
it is the road behind the mover.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aa4d.motion.tracks import Tracks

Array = NDArray[np.float64]

VOTES = 0.8  # of the frames in which the mover is seen
FRAMES = 12  # at most, evenly over those
HEIGHT_SHARE = 0.5  # of the outline's extent on the ground: no vehicle is taller than that, a pedestrian is trimmed
BELOW_SHARE = 0.1  # of it, under the ground: trajectories are not exact
MOST_VOXELS = 200_000  # candidates a mover


def seeds(tracks: Tracks, t: Array, viewmats: Array, K: Array, voxel: float) -> tuple[Array, NDArray[np.int64]]:
    """Voxel centers [M, 3] in their mover's frame, and the mover [M] of each.

    Args:
        t, viewmats: [V], [V, 4, 4] of the training frames, to which `tracks.labels` belong.
        voxel: edge, in the units of the tracks.
    """
    poses, presence = tracks.poses(t), tracks.presence(t)
    found = [
        _hull(tracks.labels, g + 1, poses[g], presence[g], tracks.up, viewmats, K, voxel) for g in range(len(tracks))
    ]
    group = np.repeat(np.arange(len(tracks)), [len(f) for f in found])
    return (np.concatenate(found) if found else np.zeros((0, 3))), group


def _hull(
    labels: NDArray[np.uint16],
    label: int,
    poses: Array,
    presence: Array,
    up: Array,
    viewmats: Array,
    K: Array,
    voxel: float,
) -> Array:
    seen = [v for v in np.flatnonzero((labels == label).any(axis=(1, 2))) if presence[v] > 0]
    if not seen:
        return np.zeros((0, 3))
    area = np.array([(labels[v] == label).sum() for v in seen])
    # Frames that show little of it (at the border, behind a tree) know little of its shape.
    seen = [v for v, a in zip(seen, area, strict=True) if a >= 0.5 * np.median(area)]
    seen = [seen[i] for i in np.unique(np.linspace(0, len(seen) - 1, min(FRAMES, len(seen))).round().astype(int))]
    masks = [labels[v] == label for v in seen]
    rotations = [_rotation(up, poses[v, 3]) for v in seen]
    on_ground = np.concatenate(
        [
            (_cast(mask, viewmats[v], K, poses[v, :3], up) - poses[v, :3]) @ R
            for v, mask, R in zip(seen, masks, rotations, strict=True)
        ]
    )
    on_ground = on_ground[np.isfinite(on_ground).all(axis=1)]
    if not len(on_ground):
        return np.zeros((0, 3))
    lower, upper = np.percentile(on_ground, 2, axis=0), np.percentile(on_ground, 98, axis=0)
    extent = float(np.linalg.norm(upper - lower))
    grid = _grid(lower, upper, up, extent, voxel)
    votes = np.zeros(len(grid))
    for v, mask, R in zip(seen, masks, rotations, strict=True):
        votes += _inside(grid @ R.T + poses[v, :3], mask, viewmats[v], K)
    kept = grid[votes >= VOTES * len(seen)]
    # Outlines that hardly overlap leave nothing: then where most of them agree.
    return kept if len(kept) else grid[votes >= max(votes.max(), 1)]


def _rotation(up: Array, heading: float) -> Array:
    """[3, 3] by `heading` about `up` (Rodrigues)."""
    x, y, z = up
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(heading) * cross + (1 - np.cos(heading)) * cross @ cross)


def _cast(mask: NDArray[np.bool_], viewmat: Array, K: Array, point: Array, up: Array) -> Array:
    """Where the rays of the mask's pixels meet the level plane through `point`; NaN where they do not."""
    rows, columns = np.nonzero(mask)
    rays = np.stack([columns + 0.5, rows + 0.5, np.ones(len(rows))], 1) @ np.linalg.inv(K).T @ viewmat[:3, :3]
    eye = -viewmat[:3, :3].T @ viewmat[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = ((point - eye) @ up) / (rays @ up)
    return np.where((distance > 0)[:, None], eye + distance[:, None] * rays, np.nan)


def _grid(lower: Array, upper: Array, up: Array, extent: float, voxel: float) -> Array:
    """Voxel centers over the box of what was cast on the ground, and above it."""
    lower = lower - BELOW_SHARE * extent * np.abs(up)
    upper = upper + HEIGHT_SHARE * extent * np.abs(up)
    first, last = np.floor(lower / voxel), np.ceil(upper / voxel)
    while np.prod(last - first + 1) > MOST_VOXELS:
        voxel *= 2
        first, last = np.floor(lower / voxel), np.ceil(upper / voxel)
    axes = [np.arange(a, b + 1) for a, b in zip(first, last, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3) * voxel


def _inside(points: Array, mask: NDArray[np.bool_], viewmat: Array, K: Array) -> NDArray[np.bool_]:
    x = points @ viewmat[:3, :3].T + viewmat[:3, 3]
    z = np.maximum(x[:, 2], 1e-9)
    columns, rows = (np.floor((x @ K.T)[:, i] / z).astype(np.int64) for i in (0, 1))
    height, width = mask.shape
    within = (x[:, 2] > 0) & (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    return np.asarray(within & mask[rows.clip(0, height - 1), columns.clip(0, width - 1)])
