"""The horizon in a picture, as a line, and whether the cameras agree with it: it says where up is, and needs no points.

Taken for a horizon is a straight, nearly level line from bright and smooth sky to something darker. Things may stand
before it, but sky must not go on below it, as it does beside a roof. Most drone clips show none; then nothing is said.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

LONGEST_PX = 480  # Longest side of the pictures in which it is looked for
STEEPEST = 0.6  # rows a column, of a camera that banks by 31 degrees
SLOPES = 61
ROWS = 4  # averaged above and below
STEP_GRAYS = 5.0  # from sky to what is below it
NEAR_PX = 2  # Distance of an outline from its line
SMOOTH_GRAYS = 3.0  # a pixel: sky has weaker slopes
SKY_PX = 40  # Rows of sky above the line that are looked at, or up to the picture's edge
CLEAR_SHARE = 0.9  # Share of those that is smooth
LEAST_SHARE = 0.2  # Share of the picture's width in which the horizon is seen
OPEN_SHARE = 0.25  # Columns in which the sky goes on below the line, as a share of that
FEWEST, FOUND_SHARE, AGREE_SHARE = 5, 0.5, 0.7  # frames; of all that show it; of those that agree with each other
STEADY_SHARE, STEADY_DEG = 0.8, 2.0  # Share that shows it; turn to the next frame, in nine of ten
AGREE_DEG, APART_DEG = 2.0, 3.0  # between ups of two frames; of one from that of most

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Horizon:
    """The verdict of frames that show a horizon on their cameras."""

    seen: int  # frames that show it
    spread_deg: float  # the widest angle between two frames' ups
    apart: tuple[int, ...]  # frames that disagree with most others on where up is
    tilt_deg: float  # Angle of the up of most frames against the world's


def horizon_line(picture: NDArray[np.uint8]) -> tuple[float, float] | None:
    """(row, slope): the horizon is at row + slope * column, from the picture's outer edges; None where there is none.

    Args:
        picture: [H, W], gray.
    """
    scale = min(1.0, LONGEST_PX / max(picture.shape))
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA).astype(np.float32)
    height, width = small.shape
    if height < 4 * ROWS or width < 4 * ROWS:
        return None
    step = _steps(small)
    is_clear = _clear_above(small)
    peak = step >= cv2.dilate(step, np.ones((2 * ROWS + 1, 1), np.uint8))
    outline = (step > STEP_GRAYS) & peak & is_clear
    found = _straightest(outline)
    for _ in range(3):
        if found is None:
            return None
        found = _fitted(outline, *found)
    if found is None or not _ends_the_sky(step, is_clear, outline, *found):
        return None
    row, slope = found
    # Row r of the small picture, a border between two rows, is r / scale from the edge of the large one.
    return (row - 0.5 * slope) / scale, slope


def horizon_of(pictures: Iterable[NDArray[np.uint8]], K: Floats, viewmats: Floats) -> Horizon | None:
    """The verdict of frames [H, W] (gray, undistorted) on cameras of `K` [3, 3] at `viewmats` [N, 4, 4]."""
    lines = (horizon_line(picture) for picture in pictures)
    return compare({i: up_in_camera(line, K) for i, line in enumerate(lines) if line is not None}, viewmats)


def up_in_camera(line: tuple[float, float], K: Floats) -> Floats:
    """[3] unit, from the horizon's line: the normal of the plane through it and the camera, towards the sky."""
    row, slope = line
    up = K.T @ np.array([slope, -1.0, row])  # above the line, smaller rows
    return np.asarray(up / np.linalg.norm(up))


def compare(ups: dict[int, Floats], viewmats: Floats) -> Horizon | None:
    """Compare cameras [N, 4, 4] with the up [3] that some frames show.

    None where too few show it, or where what they show agrees neither with most cameras nor with itself from frame to
    frame: then it is no horizon.
    """
    frames = sorted(ups)
    if len(frames) < max(FEWEST, FOUND_SHARE * len(viewmats)):
        return None
    in_world = np.array([viewmats[i, :3, :3].T @ ups[i] for i in frames])
    between = _degrees(in_world @ in_world.T)
    near = between < AGREE_DEG
    most = near[near.sum(axis=1).argmax()]
    if most.sum() < AGREE_SHARE * len(frames) and not _is_steady(ups, len(viewmats)):
        return None
    up = in_world[most].mean(axis=0)
    up /= np.linalg.norm(up)
    apart = tuple(np.array(frames)[_degrees(in_world @ up) > APART_DEG].tolist())
    return Horizon(len(frames), float(between.max()), apart, float(_degrees(up[2])))


def _is_steady(ups: dict[int, Floats], count: int) -> bool:
    turns = [ups[i] @ ups[i + 1] for i in ups if i + 1 in ups]
    return len(ups) >= STEADY_SHARE * count and float(np.percentile(_degrees(np.array(turns)), 90)) < STEADY_DEG


def _degrees(cosine: Floats) -> Floats:
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def _steps(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    """[H, W] by how much it is brighter in the rows above row r, which begin with r - 1, than in those from r on."""
    total = np.cumsum(np.pad(picture, ((1, 0), (0, 0))), axis=0)
    step = np.zeros_like(picture)
    middle = total[ROWS:-ROWS]
    step[ROWS : ROWS + len(middle)] = (2 * middle - total[: len(middle)] - total[2 * ROWS :])[: len(picture)] / ROWS
    return step


def _straightest(outline: NDArray[np.bool_]) -> tuple[float, float] | None:
    """The line (row at column 0, rows a column) that most columns have an outline near to."""
    wide = cv2.dilate(outline.astype(np.uint8), np.ones((3, 1), np.uint8)) > 0
    rows, columns = np.nonzero(wide)
    best, found = 0, None
    for slope in np.linspace(-STEEPEST, STEEPEST, SLOPES):
        starts = np.round(rows - slope * columns).astype(int)
        count = np.bincount(starts - starts.min()) if len(starts) else np.zeros(1, int)
        if count.max() > best:
            best, found = int(count.max()), (float(count.argmax() + starts.min()), float(slope))
    return found if best >= LEAST_SHARE * outline.shape[1] else None


def _fitted(outline: NDArray[np.bool_], row: float, slope: float) -> tuple[float, float] | None:
    rows, columns = np.nonzero(outline)
    near = np.abs(rows - row - slope * columns) <= NEAR_PX
    if near.sum() < LEAST_SHARE * outline.shape[1]:
        return None
    slope, row = np.polyfit(columns[near], rows[near], 1)
    return float(row), float(slope)


def _clear_above(picture: NDArray[np.float32]) -> NDArray[np.bool_]:
    """[H, W] whether there is sky, without an outline, right above a row."""
    slopes = cv2.magnitude(cv2.Sobel(picture, cv2.CV_32F, 1, 0), cv2.Sobel(picture, cv2.CV_32F, 0, 1)) / 8
    smooth = np.cumsum(np.pad((slopes < SMOOTH_GRAYS).astype(np.float32), ((1, 0), (0, 0))), axis=0)
    last = np.arange(len(picture)) - ROWS  # rows next to the line are blurred by it
    first = np.maximum(last - SKY_PX, 0)
    enough = last - first >= ROWS
    share = (smooth[np.maximum(last, 0)] - smooth[first]) / np.maximum(last - first, 1)[:, None]
    return np.asarray((share >= CLEAR_SHARE) & enough[:, None])


def _ends_the_sky(
    step: NDArray[np.float32], is_clear: NDArray[np.bool_], outline: NDArray[np.bool_], row: float, slope: float
) -> bool:
    height, width = step.shape
    away = np.abs(np.arange(height)[:, None] - row - slope * np.arange(width))
    shown = (outline & (away <= NEAR_PX)).any(axis=0)
    is_sky = (is_clear & (away <= 0.5)).any(axis=0)
    goes_on = is_sky & (np.where(away <= 2 * NEAR_PX, step, 0).max(axis=0) < STEP_GRAYS)
    return bool(shown.sum() >= LEAST_SHARE * width and goes_on.sum() <= OPEN_SHARE * shown.sum())
