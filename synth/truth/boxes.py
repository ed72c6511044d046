"""Boxes of instances and the pixels that are seen of them."""

import numpy as np
from numpy.typing import NDArray

from synth.truth.view import View

Array = NDArray[np.float64]

# Corners: below then above; in each, rear right, front right, front left, rear left.
UNIT_CORNERS = np.array(
    [[x, y, z] for z in (0.0, 1.0) for x, y in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))]
)


def corners(object_to_world: Array, dimensions_m: Array) -> Array:
    """World corners [M, 8, 3]; the origin of an instance is the centre of its footprint on the ground."""
    local = UNIT_CORNERS * dimensions_m[:, None, :]
    return np.einsum("mij,mcj->mci", object_to_world[:, :3, :3], local) + object_to_world[:, None, :3, 3]


def projected(view: View, corners_m: Array) -> tuple[Array, Array]:
    """Pixels [M, 8, 2] of corners (NaN behind the camera), and the box around them [M, 4] cut to the picture:
    left, top, right, bottom; NaN for an instance with a corner behind the camera or wholly outside the picture."""
    uv, _ = view.project(corners_m)
    size = np.array(view.size, dtype=np.float64)
    low, high = uv.min(axis=1), uv.max(axis=1)
    outside = ((high <= 0) | (low >= size)).any(axis=1)
    box = np.concatenate([np.clip(low, 0, size), np.clip(high, 0, size)], axis=1)
    box[outside | ~view.present] = np.nan
    return uv, box


def visible(instance_id: NDArray[np.uint32], ids: NDArray[np.uint32]) -> tuple[NDArray[np.uint32], NDArray[np.int32]]:
    """Seen pixels [M] of the instances `ids` (sorted), and the box around them [M, 4]: left, top, right, bottom in
    pixels, right and bottom exclusive; -1 where nothing is seen."""
    counts = np.zeros(len(ids), dtype=np.uint32)
    box = np.full((len(ids), 4), -1, dtype=np.int32)
    row, column = np.nonzero(instance_id)
    if not len(row) or not len(ids):
        return counts, box
    found, member, number = np.unique(instance_id[row, column], return_inverse=True, return_counts=True)
    low, high = np.full((len(found), 2), 2**30), np.full((len(found), 2), -1)
    at = np.stack([column, row], axis=1)
    np.minimum.at(low, member, at)
    np.maximum.at(high, member, at)
    place = np.asarray(np.searchsorted(ids, found))
    known = (place < len(ids)) & (ids[np.minimum(place, len(ids) - 1)] == found)
    counts[place[known]] = number[known]
    box[place[known]] = np.concatenate([low, high + 1], axis=1)[known]
    return counts, box
