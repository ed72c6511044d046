"""Pixels that no static point explains, at whatever depth: how movers differ from what stands, once cameras are known.

A static point has one depth, at which the frames before and after show it where they should (a plane sweep: Collins, A
space-sweep approach to true multi-image matching, CVPR 1996). What looks alike in them at no depth that the scene has
around there moves. Unlike optical flow this holds for what is thin and tall, and where the background is no plane. What
one frame hides another may show: the best pair of frames counts (Kang, Szeliski and Chai, CVPR 2001).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

AROUND = 2  # frames compared on each side
PAIRS = ((0, 1), (2, 3), (1, 2))  # Of those four in order: one pair has to agree.
WAY_PX = 16.0  # by which the nearest and the farthest depth come apart between the frames compared, at least
FARTHEST = 4  # frames from one that is compared to the next, where the drone is slow
DEPTHS = 48
CELLS = (6, 10)  # rows and columns of the picture in which the scene's depths are gathered
BEHIND, BEFORE = 0.95, 1.3  # times the least and the greatest inverse depth of points around
WINDOW_PX = 7
NOISE_GRAYS = 1.5  # a pixel: slopes of the picture that are weaker say nothing
COARSE_PX = 8  # where it is told what other frames show

Floats = NDArray[np.float64]
Picture = NDArray[np.uint8]
Grid = NDArray[np.float32]


@dataclass(frozen=True)
class Seen:
    """Frames of one pinhole camera, and points of the static scene that they show."""

    pictures: list[Picture]  # [N] of [H, W], gray
    K: Floats  # [3, 3]
    viewmats: Floats  # [N, 4, 4]
    points: Floats  # [P, 3]


def unexplained(seen: Seen, index: int) -> Grid:
    """[H, W] pixels by which a frame disagrees with those around at the depth that suits them best.

    0 where they do not show what a static point there would look like, and in a clip of fewer than five frames.
    """
    here = seen.pictures[index]
    least, most = depth_limits(seen, index)
    others = _others(seen, index, least, most)
    if not others:
        return np.zeros(here.shape, np.float32)
    motions = [_motion(seen, index, other) for other in others]
    shown = [_shown(seen.K, motion, least, most, here.shape) for motion in motions]
    hidden = [np.where(shown[a] & shown[b], 0, np.inf).astype(np.float32) for a, b in PAIRS]
    pictures = [_as_bright(seen.pictures[other], here) for other in others]
    least, most = _spread(least, here.shape), _spread(most, here.shape)
    best = np.full(here.shape, np.inf, np.float32)
    for inverse in np.linspace(least.min(), most.max(), DEPTHS):
        away = [
            cv2.boxFilter(cv2.absdiff(here, _at_depth(there, seen.K, motion, inverse)), cv2.CV_32F, (WINDOW_PX,) * 2)
            for there, motion in zip(pictures, motions, strict=True)
        ]
        pairs = [np.maximum(away[a], away[b]) + gone for (a, b), gone in zip(PAIRS, hidden, strict=True)]
        least_away = np.minimum.reduce(pairs)
        least_away[(inverse < least) | (inverse > most)] = np.inf
        np.minimum(best, least_away, out=best)
    best[~np.isfinite(best)] = 0
    return np.asarray(best / (_slope(here) + NOISE_GRAYS), np.float32)


def depth_limits(seen: Seen, index: int) -> tuple[Grid, Grid]:
    """Least and greatest inverse depth of static things [CELLS], by the points that a frame shows around there.

    What moves as something far below the ground or high in the air would is beyond them.
    """
    height, width = seen.pictures[index].shape
    in_camera = seen.points @ seen.viewmats[index, :3, :3].T + seen.viewmats[index, :3, 3]
    in_camera = in_camera[in_camera[:, 2] > 0]
    pixels = ((in_camera / in_camera[:, 2:]) @ seen.K.T)[:, :2]
    inside = (pixels >= 0).all(axis=1) & (pixels < [width, height]).all(axis=1)
    column, row = (pixels[inside] * [CELLS[1] / width, CELLS[0] / height]).astype(int).T
    inverse = (1 / in_camera[inside, 2]).astype(np.float32)
    least, most = np.full(CELLS, np.inf, np.float32), np.zeros(CELLS, np.float32)
    np.minimum.at(least, (row, column), inverse)
    np.maximum.at(most, (row, column), inverse)
    around = np.ones((3, 3), np.uint8)
    least, most = np.asarray(cv2.erode(least, around)), np.asarray(cv2.dilate(most, around))
    # Where no points are, as in the sky, anything may stand anywhere.
    least = np.where(np.isfinite(least), BEHIND * least, 0)
    most = BEFORE * np.where(most > 0, most, most.max())
    return least.astype(np.float32), most.astype(np.float32)


def _spread(cells: Grid, shape: tuple[int, ...]) -> Grid:
    return np.asarray(cv2.resize(cells, (shape[1], shape[0]), interpolation=cv2.INTER_NEAREST))


def _motion(seen: Seen, index: int, other: int) -> Floats:
    """[4, 4] from a frame's camera to another's."""
    motion: Floats = seen.viewmats[other] @ np.linalg.inv(seen.viewmats[index])
    return motion


def _others(seen: Seen, index: int, least: Grid, most: Grid) -> list[int]:
    """The four frames to compare with, in order: two on each side, at the ends of the clip those that there are."""
    count, sides = len(seen.pictures), 2 * AROUND
    if count <= sides:
        return []
    height, width = seen.pictures[index].shape
    rays = _rays(seen.K, width, height, CELLS)
    motion = _motion(seen, index, index + 1 if index + 1 < count else index - 1)
    way = _pixels(seen.K, motion, rays, most) - _pixels(seen.K, motion, rays, least)
    lengths = np.linalg.norm(way, axis=-1)
    way_px = float(np.median(lengths[np.isfinite(lengths)])) if np.isfinite(lengths).any() else WAY_PX
    apart = int(np.clip(np.ceil(WAY_PX / max(way_px, 1e-6)), 1, min(FARTHEST, (count - 1) // sides)))
    before, after = index // apart, (count - 1 - index) // apart
    if before + after < sides:
        apart, before, after = 1, index, count - 1 - index
    first = -min(before, max(AROUND, sides - after))
    return [index + k * apart for k in range(first, first + sides + 1) if k]


def _as_bright(there: Picture, here: Picture) -> Picture:
    """A changed exposure is no motion."""
    return np.asarray(cv2.convertScaleAbs(there, alpha=float(here.mean()) / max(float(there.mean()), 1.0)))


def _rays(K: Floats, width: int, height: int, cells: tuple[int, int]) -> Floats:
    """[rows, columns, 3] at depth 1, through the middles of cells of the picture."""
    columns = (np.arange(cells[1]) + 0.5) * width / cells[1]
    rows = (np.arange(cells[0]) + 0.5) * height / cells[0]
    x, y = np.meshgrid((columns - K[0, 2]) / K[0, 0], (rows - K[1, 2]) / K[1, 1])
    return np.stack([x, y, np.ones_like(x)], axis=-1)


def _pixels(K: Floats, motion: Floats, rays: Floats, inverse: Grid) -> Floats:
    """[..., 2] where another frame shows what lies on rays [..., 3] of this one; NaN behind the camera."""
    moved = rays @ motion[:3, :3].T + inverse[..., None] * motion[:3, 3]
    depth = np.where(moved[..., 2:] > 1e-9, moved[..., 2:], np.nan)
    pixels: Floats = ((moved / depth) @ K.T)[..., :2]
    return pixels


def _shown(K: Floats, motion: Floats, least: Grid, most: Grid, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """[H, W]: what lies inside of another frame at all depths that it may have."""
    height, width = shape
    cells = (max(height // COARSE_PX, 1), max(width // COARSE_PX, 1))
    rays, margin = _rays(K, width, height, cells), WINDOW_PX
    inside = np.ones(cells, bool)
    for inverse in (least, most):
        pixels = _pixels(K, motion, rays, _spread(inverse, cells))
        inside &= (pixels >= margin).all(axis=-1) & (pixels < [width - margin, height - margin]).all(axis=-1)
    return _spread(inside.astype(np.float32), shape) > 0


def _at_depth(there: Picture, K: Floats, motion: Floats, inverse: float) -> Picture:
    """[H, W] what another frame shows of the plane at that inverse depth before this one."""
    homography = K @ (motion[:3, :3] + inverse * np.outer(motion[:3, 3], [0, 0, 1])) @ np.linalg.inv(K)
    # OpenCV's pixel centers are whole numbers.
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    homography = np.linalg.inv(half) @ homography @ half
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpPerspective(there, homography, there.shape[::-1], flags=flags))


def _slope(picture: Picture) -> Grid:
    """Gray levels a pixel, around each."""
    across = cv2.Sobel(picture, cv2.CV_32F, 1, 0) / 8
    down = cv2.Sobel(picture, cv2.CV_32F, 0, 1) / 8
    return np.asarray(cv2.boxFilter(cv2.magnitude(across, down), -1, (WINDOW_PX,) * 2))
