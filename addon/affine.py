"""Affine maps of points that are Gaussians: what a transform does to places, sizes and rotations. No bpy here."""

from collections.abc import Mapping

import numpy as np

from . import harmonics, names
from .container import Floats
from .groups import product
from .model import Doubles

SAME = 1e-6  # by how much the axes of a map may differ from a similarity's, relative to its scale
FLAT = 1e-5  # points whose extent along an axis is a smaller share of the largest tell nothing about that axis
EXACT = 2e-5  # of the largest coordinate: what float32 and Blender's own arithmetic lose


def moved(values: Mapping[names.Attribute, Floats], matrix: Doubles) -> dict[names.Attribute, Floats]:
    """The attributes of points after the map [4, 4]; those that it does not change are passed on as they are.

    An ellipsoid becomes the ellipsoid that the map makes of it, sheared and mirrored ones too; a radius grows with the
    cube root of the volume.
    """
    result = dict(values)
    linear = matrix[:3, :3]
    grown = float(np.cbrt(abs(np.linalg.det(linear))))
    result[names.POSITION] = moved_places(values[names.POSITION], matrix)
    if names.RADIUS in values:
        result[names.RADIUS] = np.float32(grown) * values[names.RADIUS]
    if names.SCALE in values and names.ROTATION in values:
        turn = linear / max(grown, 1e-30)
        if np.linalg.det(turn) > 0 and np.abs(turn @ turn.T - np.eye(3)).max() < SAME:
            result[names.SCALE] = np.float32(grown) * values[names.SCALE]
            result[names.ROTATION] = product(quaternions_of(turn[None])[0], values[names.ROTATION])
        else:
            axes = linear @ rotations_of(values[names.ROTATION]) * values[names.SCALE][:, None]
            turned, sizes, _ = np.linalg.svd(axes)
            turned[..., 2] *= np.linalg.det(turned)[:, None]  # the axis of a mirrored ellipsoid has no direction
            result[names.SCALE] = sizes.astype(np.float32)
            result[names.ROTATION] = quaternions_of(turned)
    terms = [term for term in names.HARMONICS if term in values]
    if terms:
        coefficients = np.stack([values[term] for term in terms], axis=1).astype(np.float64)
        first, _, second = np.linalg.svd(linear)  # the rotation in it, or the reflection
        turned = harmonics.turned(coefficients, first @ second).astype(np.float32)
        result |= dict(zip(terms, turned.swapaxes(0, 1), strict=True))
    return result


def moved_places(places: Floats, matrix: Doubles) -> Floats:
    """Places [n, 3] after the map [4, 4]."""
    return (places.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32)


def fit(before: Floats, after: Floats) -> Doubles | None:
    """The map [4, 4] that takes all places [n, 3] to others, or None where no map does.

    Along axes in which the points have no extent it changes nothing.
    """
    first, second = before.astype(np.float64), after.astype(np.float64)
    middle, target = first.mean(axis=0), second.mean(axis=0)
    beside = first - middle
    change = np.linalg.lstsq(beside, second - target - beside, rcond=FLAT)[0].T
    matrix = np.eye(4)
    matrix[:3, :3] += change
    matrix[:3, 3] = target - matrix[:3, :3] @ middle
    return matrix if same_places(moved_places(before, matrix), after) else None


def same_places(first: Floats, second: Floats) -> bool:
    """Whether two lists of places [n, 3] differ by no more than rounding."""
    largest = max(1.0, float(np.abs(first).max(initial=0)), float(np.abs(second).max(initial=0)))
    return float(np.abs(first - second).max(initial=0)) <= EXACT * largest


def rotations_of(quaternions: Floats) -> Doubles:
    """Rotation matrices [n, 3, 3] of unit quaternions [n, 4], w x y z."""
    w, x, y, z = quaternions.astype(np.float64).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)


def quaternions_of(rotations: Doubles) -> Floats:
    """Unit quaternions [n, 4], w x y z, of rotation matrices [n, 3, 3]: the largest component is found first."""
    r = rotations
    trace = r[:, 0, 0] + r[:, 1, 1] + r[:, 2, 2]
    squares = np.stack([trace, *(2 * r[:, axis, axis] - trace for axis in range(3))], axis=1)  # 4 q^2 - 1
    w = [r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]]
    xy, xz, yz = (r[:, i, j] + r[:, j, i] for i, j in ((0, 1), (0, 2), (1, 2)))
    candidates = np.stack(  # row k: the quaternion times 4 q_k
        [
            np.stack([1 + squares[:, 0], *w], axis=1),
            np.stack([w[0], 1 + squares[:, 1], xy, xz], axis=1),
            np.stack([w[1], xy, 1 + squares[:, 2], yz], axis=1),
            np.stack([w[2], xz, yz, 1 + squares[:, 3]], axis=1),
        ],
        axis=1,
    )
    best = candidates[np.arange(len(r)), squares.argmax(axis=1)]
    return (best / np.linalg.norm(best, axis=1, keepdims=True)).astype(np.float32)
