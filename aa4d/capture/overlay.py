"""What stands still in the picture while the camera moves: an on-screen display, a logo, dirt on the lens."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

LOOKED_AT = 24  # frames, evenly over the clip
FEWEST = 8
LONGEST_PX = 640  # of the pictures in which it is looked for
EDGE_GRAYS = 30.0  # brightness that changes from one pixel to the next but one: an outline
STILL_GRAYS = 10.0  # change in nine of ten frames: what stands still
MOVING_GRAYS = 12.0  # median change over time of outlines that do not: with less, the camera hovers
LEAST_SHARE = 2e-4  # of the picture's pixels that are still outlines
CELLS = 3  # the picture is called top left and so on by thirds
ROWS, COLUMNS = ("top", "middle", "bottom"), ("left", "center", "right")


def still_outlines(pictures: list[NDArray[np.uint8]]) -> NDArray[np.bool_]:
    """[H, W] outlines that all of the gray pictures [H, W] have in one place; none where the camera hardly moves."""
    stack = np.stack(pictures).astype(np.float32)
    usual = np.median(stack, axis=0)
    usually, mostly = np.percentile(np.abs(stack - usual), (50, 90), axis=0)
    one = stack[len(stack) // 2]
    outlines, everywhere = _is_outline(one), _is_outline(usual)
    passing = usually[outlines & ~everywhere]
    if not len(passing) or float(np.median(passing)) < MOVING_GRAYS:
        return np.zeros(usual.shape, bool)
    # Of what passes by, the median over time is smooth: a sharp outline there stands still in the picture.
    return everywhere & outlines & (mostly < STILL_GRAYS)


def _is_outline(picture: NDArray[np.float32]) -> NDArray[np.bool_]:
    slope = np.maximum(np.abs(cv2.Sobel(picture, cv2.CV_32F, 1, 0)), np.abs(cv2.Sobel(picture, cv2.CV_32F, 0, 1))) / 4
    return np.asarray(slope > EDGE_GRAYS)


def overlay_note(files: list[Path]) -> str | None:
    """A sentence on what is burned into the frames in `files`; None where nothing is."""
    chosen = sorted(set(np.linspace(0, len(files) - 1, min(LOOKED_AT, len(files))).round().astype(int).tolist()))
    if len(chosen) < FEWEST:
        return None
    pictures = []
    for index in chosen:
        gray = cv2.imdecode(np.fromfile(files[index], np.uint8), cv2.IMREAD_GRAYSCALE)
        scale = min(1.0, LONGEST_PX / max(gray.shape))
        pictures.append(np.asarray(cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8))
    still = still_outlines(pictures)
    if still.mean() < LEAST_SHARE:
        return None
    return (
        f"something stands still in the picture ({', '.join(_places(still))}) while the camera moves, as an on-screen "
        "display does: it is learned as part of the scene; record without it, or cut it off"
    )


def _places(still: NDArray[np.bool_]) -> list[str]:
    """Thirds of the picture that hold a tenth of it or more."""
    rows, columns = np.nonzero(still)
    cells = (rows * CELLS // still.shape[0]) * CELLS + columns * CELLS // still.shape[1]
    count = np.bincount(cells, minlength=CELLS * CELLS)
    return [f"{ROWS[i // CELLS]} {COLUMNS[i % CELLS]}" for i in np.flatnonzero(count >= 0.1 * count.sum())]
