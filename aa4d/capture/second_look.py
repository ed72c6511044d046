"""Masks of movers once more, with the cameras known: what was masked and stands still, however tall, is let go.

The first look (movers.py) keeps features off what may move; it knows no cameras, and takes the parallax of tall things
for motion where the background is no plane. This one asks whether any static depth explains what is seen
(static_depth.py). A patch of the first look is let go if one explains nearly all of it. On demand, what no depth
explains is masked too; where the first look saw motion, less is enough.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from aa4d.capture.movers import FLOW_PX, MAX_MOVING_FRACTION
from aa4d.capture.pictures import read_gray, save_png
from aa4d.capture.placement import Placement
from aa4d.capture.static_depth import Floats, Seen, unexplained
from aa4d.capture.undistortion import Pictures
from aa4d.capture.workspace import Progress, Step, StepResult

STILL, STILL_SHARE = 0.7, 0.75  # pixels of disagreement: of less, and of so much of a patch, it stands still
JUDGED_SHARE = 0.5  # Share of a patch: with less of it in other frames, nothing can be said
SURE, LIKELY = 3.0, 1.5  # pixels of disagreement: of a mover, and of one that the first look saw as well
GROWN = 1.1  # pixels: what belongs to it
SEED_PIXELS = 12  # that a mover has of those
CLOSED_PX = 11  # windows and roofs of one color disagree less than their outlines
BORDER_PX = 7  # a mask is wider than what was found: blurred outlines belong to the car

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class SecondMasks(StepResult):
    """NAME.mask.png of every frame of the capture: white is what moves."""

    share: float  # fraction of the pixels


def second_look_step(placement: Placement, pictures: Pictures, adds: bool) -> Step[SecondMasks]:
    """Look at the undistorted `pictures`, which come with masks of the first look; `adds`: for what that missed too."""
    return Step(
        "second-look", [adds], lambda *place: write_second_masks(placement, pictures, adds, *place), SecondMasks
    )


def write_second_masks(
    placement: Placement, pictures: Pictures, adds: bool, folder: Path, progress: Progress
) -> SecondMasks:
    names = [shot.name for shot in placement.shots]
    files = [pictures.folder / f"{name}.png" for name in names]
    viewmats = np.array([shot.viewmat for shot in placement.shots])
    pinhole = placement.pinhole
    seen = frames_seen(files, pinhole.K, (pinhole.width, pinhole.height), viewmats, placement.cloud.positions)
    shares = []
    for index, name in enumerate(names):
        target = folder / f"{name}.mask.png"
        if not target.exists():
            first = read_gray(pictures.folder / f"{name}.mask.png") > 0
            moving = second_mask(seen, index, first, adds)
            save_png(target, np.where(moving, 255, 0).astype(np.uint8))
        shares.append(float((read_gray(target) > 0).mean()))
        progress(index + 1, len(names))
    return SecondMasks(folder, float(np.mean(shares)))


def second_mask(seen: Seen, index: int, first: Mask, adds: bool) -> Mask:
    """The first look's mask without what stands still, and, if it `adds`, with what that missed."""
    if not (adds or first.any()):
        return first
    off = unexplained(seen, index)
    kept = without_static(off, first)
    both = kept | moving_pixels(off, first) if adds else kept
    # Where so much moves, the cameras are wrong rather than the first look.
    return kept if both.mean() > MAX_MOVING_FRACTION else both


def frames_seen(files: list[Path], K: Floats, size: tuple[int, int], viewmats: Floats, points: Floats) -> Seen:
    """Pictures of `size` (width, height) by a camera `K` [3, 3] at `viewmats` [N, 4, 4], small enough to compare."""
    scale = FLOW_PX / max(size)
    return Seen([_scaled(file, scale) for file in files], np.diag([scale, scale, 1.0]) @ K, viewmats, points)


def without_static(off: NDArray[np.float32], first: Mask) -> Mask:
    """The first look's mask without those of its patches that nearly all stand still.

    Args:
        off: [H, W] pixels by which no static depth explains what is seen; 0 where other frames do not show it.
    """
    off = np.asarray(cv2.resize(off, first.shape[::-1], interpolation=cv2.INTER_NEAREST))
    count, labels, statistics, _ = cv2.connectedComponentsWithStats(first.astype(np.uint8), connectivity=8)
    judged = np.bincount(labels[off > 0], minlength=count)
    still = np.bincount(labels[(off > 0) & (off <= STILL)], minlength=count)
    is_static = (still > STILL_SHARE * judged) & (judged >= JUDGED_SHARE * statistics[:, cv2.CC_STAT_AREA])
    return np.asarray(first & ~is_static[labels])


def moving_pixels(off: NDArray[np.float32], first: Mask) -> Mask:
    """Mask of what moves, with a border, of the size of `first`: the first look's mask.

    Args:
        off: [H, W] pixels by which no static depth explains what is seen.
    """
    likely = cv2.resize(first.astype(np.uint8), off.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
    count, labels = cv2.connectedComponents((off > GROWN).astype(np.uint8), connectivity=8)
    seeds = np.bincount(labels[(off > SURE) | (likely & (off > LIKELY))], minlength=count)
    kept = seeds >= SEED_PIXELS
    kept[0] = False
    closed = cv2.morphologyEx(kept[labels].astype(np.uint8), cv2.MORPH_CLOSE, _disc(CLOSED_PX))
    grown = cv2.dilate(closed, _disc(BORDER_PX))
    return np.asarray(cv2.resize(grown, first.shape[::-1], interpolation=cv2.INTER_NEAREST)) > 0


def _disc(size: int) -> NDArray[np.uint8]:
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)))


def _scaled(path: Path, scale: float) -> NDArray[np.uint8]:
    kind = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(read_gray(path), None, fx=scale, fy=scale, interpolation=kind))
