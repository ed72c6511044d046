"""What stands still in the picture while the camera moves: an on-screen display, a logo, dirt on the lens."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from aa4d.capture.clip import Clip
from aa4d.capture.pictures import read_gray, save_png
from aa4d.capture.workspace import Progress, Step, StepResult

LOOKED_AT = 24  # frames, evenly over the clip
FEWEST = 8
LONGEST_PX = 640  # of the pictures in which it is looked for
EDGE_GRAYS = 30.0  # brightness that changes from one pixel to the next but one: an outline
STILL_GRAYS = 10.0  # change in nine of ten frames: what stands still
MOVING_GRAYS = 12.0  # median change over time of outlines that do not: with less, the camera hovers
LEAST_SHARE = 2e-4  # of the picture's pixels that are still outlines
FILLED_PX, AROUND_PX = 9, 7  # between the outlines of a letter, and beyond its blurred edge
NOTED = "something stands still in the picture"
CELLS = 3  # the picture is called top left and so on by thirds
ROWS, COLUMNS = ("top", "middle", "bottom"), ("left", "center", "right")


@dataclass(frozen=True)
class Overlay(StepResult):
    share: float  # fraction of the pixels; 0 where nothing is burned in

    @property
    def mask(self) -> Path:
        """Black where something is burned into all frames, as COLMAP wants it."""
        return self.folder / "mask.png"

    def covers(self) -> NDArray[np.bool_]:
        """[H, W] of the clip's frames."""
        return read_gray(self.mask) == 0


def overlay_step(clip: Clip) -> Step[Overlay]:
    def run(folder: Path, progress: Progress) -> Overlay:
        progress(0, 1)
        still, size = still_in([clip.folder / frame.file for frame in clip.frames]), (clip.width, clip.height)
        mask = np.zeros(size[::-1], bool) if still is None else covered(still, size)
        overlay = Overlay(folder, float(mask.mean()))
        save_png(overlay.mask, np.where(mask, 0, 255).astype(np.uint8))
        progress(1, 1)
        return overlay

    return Step("overlay", None, run, Overlay)


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


def still_in(files: list[Path]) -> NDArray[np.bool_] | None:
    """[H, W] outlines of what is burned into the frames in `files`, 640 pixels wide at most; None where nothing is."""
    chosen = sorted(set(np.linspace(0, len(files) - 1, min(LOOKED_AT, len(files))).round().astype(int).tolist()))
    if len(chosen) < FEWEST:
        return None
    pictures = []
    for index in chosen:
        gray = read_gray(files[index])
        scale = min(1.0, LONGEST_PX / max(gray.shape))
        pictures.append(np.asarray(cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8))
    still = still_outlines(pictures)
    return None if still.mean() < LEAST_SHARE else still


def overlay_note(files: list[Path]) -> str | None:
    """A sentence on what is burned into the frames in `files`; None where nothing is."""
    still = still_in(files)
    if still is None:
        return None
    return (
        f"{NOTED} ({', '.join(_places(still))}) while the camera moves, as an on-screen display does, or what is very "
        "far away; a display is learned as part of the scene: record without it, cut it off, or use --overlay leave-out"
    )


def covered(still: NDArray[np.bool_], size: tuple[int, int]) -> NDArray[np.bool_]:
    """[H, W] pixels that outlines of `still_in` enclose, with a border, in frames of `size` (width, height)."""
    around = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (AROUND_PX, AROUND_PX))
    inside = cv2.getStructuringElement(cv2.MORPH_RECT, (FILLED_PX, FILLED_PX))
    filled = cv2.dilate(cv2.morphologyEx(still.astype(np.uint8), cv2.MORPH_CLOSE, inside), around)
    return np.asarray(cv2.resize(filled, size, interpolation=cv2.INTER_NEAREST)) > 0


def _places(still: NDArray[np.bool_]) -> list[str]:
    """Thirds of the picture that hold a tenth of it or more."""
    rows, columns = np.nonzero(still)
    cells = (rows * CELLS // still.shape[0]) * CELLS + columns * CELLS // still.shape[1]
    count = np.bincount(cells, minlength=CELLS * CELLS)
    return [f"{ROWS[i // CELLS]} {COLUMNS[i % CELLS]}" for i in np.flatnonzero(count >= 0.1 * count.sum())]
