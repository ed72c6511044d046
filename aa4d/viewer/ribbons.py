"""Where things go, as ribbons that lie flat on their way, drawn into a picture."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from aa4d.capture.schema import PinholeCamera
from aa4d.inspection.trajectories import Trajectory

OPACITY_PAST, OPACITY_COMING = 0.85, 0.4
HIDDEN = 0.25  # of its opacity, what shows of a ribbon behind something
SUNK = 0.02  # of its distance, how deep it may lie in the ground and still be seen
FRACTION_BITS = 4  # of pixel coordinates, for OpenCV
FARTHEST_PX = 1e6

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Ribbon:
    color: tuple[float, float, float]  # sRGB in [0, 1]
    times: Array  # [S] of t
    left: Array  # [S, 3] metres
    right: Array  # [S, 3]
    there: NDArray[np.bool_]  # [S]


def ribbon_of(path: Trajectory, width_m: float) -> Ribbon:
    """As wide as `width_m`, level, across the way; what stands still has a ribbon of no area."""
    along = np.gradient(path.position_m, axis=0)[:, :2]
    pace = np.linalg.norm(along, axis=1, keepdims=True)
    across = np.zeros_like(path.position_m)
    across[:, :2] = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.where(pace > 1e-9, pace, np.inf)
    half = across * width_m / 2
    return Ribbon(path.color, path.times, path.position_m + half, path.position_m - half, path.there)


def with_ribbons(
    pixels: NDArray[np.uint8],
    depth_m: NDArray[np.float32],
    viewmat: Array,
    camera: PinholeCamera,
    ribbons: tuple[Ribbon, ...],
    t: float,
) -> NDArray[np.uint8]:
    """The picture [H, W, 3] with the ribbons over it: what is past strong, what is to come faint.

    Args:
        depth_m: [H, W] of the scene, NaN where nothing is; what lies behind it shines through.
    """
    quads, depth, color, opacity = _quads(viewmat, camera, ribbons, t)
    if not len(quads):
        return pixels
    nearest = np.zeros(depth_m.shape, np.float32)  # the number of the quad that covers a pixel, from 1
    for number in np.argsort(-depth):
        cv2.fillConvexPoly(nearest, quads[number], (float(number + 1),), shift=FRACTION_BITS)
    covered = nearest > 0
    shown = nearest[covered].astype(np.int64) - 1
    behind = depth[shown] * (1 - SUNK) > np.nan_to_num(depth_m[covered], nan=np.inf)
    alpha = (opacity[shown] * np.where(behind, HIDDEN, 1.0))[:, None]
    blended = pixels.copy()
    blended[covered] = (pixels[covered] * (1 - alpha) + color[shown] * 255 * alpha).round()
    return blended


def _quads(
    viewmat: Array, camera: PinholeCamera, ribbons: tuple[Ribbon, ...], t: float
) -> tuple[NDArray[np.int32], Array, Array, Array]:
    """Corners [Q, 4, 2] in fractions of pixels, least depth [Q] metres, colour [Q, 3], opacity [Q] of what is seen."""
    parts: tuple[list[Array], list[Array], list[Array], list[Array]] = ([], [], [], [])
    for ribbon in ribbons:
        edges = np.stack([ribbon.left, ribbon.right], axis=1) @ viewmat[:3, :3].T + viewmat[:3, 3]  # [S, 2, 3]
        in_front = (edges[..., 2] > 1e-3).all(axis=1) & ribbon.there
        px = edges @ camera.K.T / np.where(edges[..., 2:] > 1e-3, edges[..., 2:], 1)
        corners = np.concatenate([px[:-1, :, :2], px[1:, ::-1, :2]], axis=1)  # [S - 1, 4, 2]
        low, high = corners.min(axis=1), corners.max(axis=1)
        in_view = (high > 0).all(axis=1) & (low < [camera.width, camera.height]).all(axis=1)
        sane = np.abs(corners).max(axis=(1, 2)) < FARTHEST_PX / (1 << FRACTION_BITS)
        kept = in_front[:-1] & in_front[1:] & in_view & sane
        parts[0].append(corners[kept])
        parts[1].append(np.minimum(edges[:-1, :, 2].min(axis=1), edges[1:, :, 2].min(axis=1))[kept])
        parts[2].append(np.tile(ribbon.color, (int(kept.sum()), 1)))
        parts[3].append(np.where(ribbon.times[1:] <= t, OPACITY_PAST, OPACITY_COMING)[kept])
    if not parts[0]:
        return np.zeros((0, 4, 2), np.int32), *(np.zeros(0) for _ in range(3))  # type: ignore[return-value]
    corners, depth, color, opacity = (np.concatenate(part) for part in parts)
    return ((corners - 0.5) * (1 << FRACTION_BITS)).round().astype(np.int32), depth, color, opacity
