"""Masks of what moves: from annotated boxes, else from motion that disagrees with the background's epipolar geometry.

Between two frames a static point may only move along its epipolar line (Hartley and Zisserman, Multiple View Geometry,
chapter 9), and where the scene is flat or the camera only turns, by one homography. A pixel whose optical flow to the
frames before *and* after fits neither is taken for a mover. What drives along the epipolar lines, that is towards or
away from where the drone is flying, is not found; a car that stands is not one either.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from aa4d.capture.annotations import Annotations
from aa4d.capture.clip import Clip
from aa4d.capture.pictures import read_gray, save_png
from aa4d.capture.selection import abbreviate
from aa4d.capture.workspace import Progress, Step, StepResult

FLOW_PX = 640  # longest side of the pictures in which motion is measured
MIN_MOTION_PX = 12.0  # motion of the background, in those pictures, between the frames that are compared
FARTHEST = 4  # frames, where the drone is slow
DISAGREEMENT_PX = 0.9
INLIER_PX = 0.5  # tolerance of the background's own motion
CONTRAST_AROUND_PX, LEAST_CONTRAST = 3.0, 4.0  # gray levels, of the picture's second derivative around a pixel
LEAST_TEXTURED = 0.3  # share of a patch: with less there is nothing whose motion could be measured
AROUND_PX = 9  # a mask is wider than what was found: blurred outlines belong to the car
SAMPLES = 4000  # flow vectors that the background's motion is estimated from
BORDER_SHARE = 0.3  # fraction of a box, on every side: the shadow and the blurred outline belong to the car
MIN_PATCH_FRACTION = 1.5e-4  # fraction of image area, of a moving patch
MIN_BOXED_FRACTION = 0.5  # fraction of the frames used: with less, a note says so
MAX_MOVING_FRACTION = 0.35  # fraction of image area: where more seems to move, the background was not found

Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Masks(StepResult):
    share: tuple[float, ...]  # fraction of each frame's pixels
    notes: tuple[str, ...]


def movers_step(clip: Clip, annotations: Annotations | None) -> Step[Masks]:
    boxes = None if annotations is None else annotations.file.read_text(encoding="utf-8")
    return Step("movers", [boxes], lambda *place: write_masks(clip, annotations, *place), Masks)


def masking_method(annotations: Annotations | None) -> str:
    """Name of the way in which movers are found."""
    return "epipolar motion" if annotations is None else f"boxes ({annotations.layout})"


def mask_path(folder: Path, file: str) -> Path:
    """COLMAP looks for the mask of `a.jpg` in `a.jpg.png`; features are found where it is not black."""
    return folder / f"{file}.png"


def write_masks(clip: Clip, annotations: Annotations | None, folder: Path, progress: Progress) -> Masks:
    """Write one mask a frame, black where something moves. Raises InputError where the boxes are of other frames."""
    notes: list[str] = []
    if annotations is not None:
        annotations.check_size(*clip.source_size)
        if annotations.empty:
            notes.append(f"{annotations.file}: {annotations.empty} boxes without width or height are left out")
        masks: Callable[[int], Mask] = lambda i: box_mask(clip, annotations.of(clip.frames[i].number))  # noqa: E731
    else:
        masks = EpipolarMotion(clip).mask
    shares, unmasked = [], []
    for i, frame in enumerate(clip.frames):
        path = mask_path(folder, frame.file)
        moving = read_mask(path) if path.exists() else masks(i)
        if moving.mean() > MAX_MOVING_FRACTION:
            unmasked.append(frame.label)
            moving = np.zeros_like(moving)
        if not path.exists():
            save_png(path, np.where(moving, 0, 255).astype(np.uint8))
        shares.append(float(moving.mean()))
        progress(i + 1, len(clip.frames))
    if unmasked:
        notes.append(f"{abbreviate(unmasked)}: more than a third of the picture seems to move; no mask is used there")
    if annotations is not None:
        boxed = sum(f.number in annotations.boxes for f in clip.frames)
        if boxed < MIN_BOXED_FRACTION * len(clip.frames):
            notes.append(
                f"{annotations.file} has boxes for {boxed} of the {len(clip.frames)} frames used: "
                "in the others no mover is masked"
            )
    return Masks(folder, tuple(shares), tuple(notes))


def read_mask(path: Path) -> Mask:
    """[H, W]: where a stored mask is black, something moves."""
    return read_gray(path) == 0


def box_mask(clip: Clip, boxes: NDArray[np.float64]) -> Mask:
    """Boxes [M, 4] (left, top, width, height, source pixels), each with a border, as a mask of the clip's size."""
    mask = np.zeros((clip.height, clip.width), bool)
    scale = clip.width / clip.source_size[0]
    for left, top, width, height in boxes * scale:
        x0, x1 = left - BORDER_SHARE * width, left + (1 + BORDER_SHARE) * width
        y0, y1 = top - BORDER_SHARE * height, top + (1 + BORDER_SHARE) * height
        rows = slice(max(int(y0), 0), max(int(np.ceil(y1)), 0))
        mask[rows, max(int(x0), 0) : max(int(np.ceil(x1)), 0)] = True
    return mask


class EpipolarMotion:
    """Masks of one clip; keeps the grey pictures of the frames around."""

    def __init__(self, clip: Clip) -> None:
        self.clip = clip
        self.scale = FLOW_PX / max(clip.width, clip.height)
        self._grey: dict[int, NDArray[np.uint8]] = {}
        self._rough, self._fine = rough_flow(), fine_flow()

    def mask(self, index: int) -> Mask:
        """[H, W] at the clip's size: what disagrees with the background in both directions of time."""
        # The first and the last frame have neighbours on one side: two different ones stand in.
        found = [r for r in (self._towards(index, -1), self._towards(index, +1)) if r is not None]
        if len(found) == 1:
            further = self._towards(index, -1 if index else +1, nearest=2)
            found += [] if further is None else [further]
        size = (self.clip.width, self.clip.height)
        if not found:
            return np.zeros(size[::-1], bool)
        # What one frame hides and the other shows disagrees in one direction only.
        residual = cv2.GaussianBlur(np.minimum.reduce(found), (0, 0), 1.0)
        moving = without_bare(without_specks((residual > DISAGREEMENT_PX).astype(np.uint8)), self._picture(index))
        around = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (AROUND_PX, AROUND_PX))
        full = cv2.resize(cv2.dilate(moving, around), size, interpolation=cv2.INTER_NEAREST)
        return np.asarray(full, bool)

    def _picture(self, index: int) -> NDArray[np.uint8]:
        if index not in self._grey:
            for far in [i for i in self._grey if abs(i - index) > FARTHEST + 1]:
                del self._grey[far]
            grey = read_gray(self.clip.folder / self.clip.frames[index].file)
            kind = cv2.INTER_AREA if self.scale < 1 else cv2.INTER_CUBIC
            self._grey[index] = np.asarray(cv2.resize(grey, None, fx=self.scale, fy=self.scale, interpolation=kind))
        return self._grey[index]

    def _towards(self, index: int, direction: int, nearest: int = 1) -> Floats | None:
        """Pixels of disagreement with the nearest frame before or after to which the background has moved enough."""
        flow, here = None, self._picture(index)
        for step in range(nearest, nearest + FARTHEST):
            other = index + direction * step
            if not 0 <= other < len(self.clip.frames):
                break
            there = self._picture(other)
            flow = np.asarray(self._rough.calc(here, there, no_guess(here)), np.float32)
            if float(np.median(np.linalg.norm(flow, axis=2))) >= MIN_MOTION_PX:
                break
        found = None if flow is None else beside_background(here, there, flow, self._fine)
        return None if found is None else found[0]


def beside_background(
    here: NDArray[np.uint8], there: NDArray[np.uint8], rough: Floats, fine: cv2.DISOpticalFlow
) -> tuple[Floats, Floats] | None:
    """Distance of the motion from what a static scene allows [H, W], and from the background's [H, W, 2]; pixels.

    None where the background's motion cannot be told. Motion is measured once more after the background's homography is
    taken out: what is left is small but for parallax and movers, so that small movers are not smoothed away.
    """
    height, width = here.shape
    columns, rows = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    start = np.stack([columns, rows], axis=-1).reshape(-1, 2)
    sample = np.linspace(0, len(start) - 1, SAMPLES).astype(int)
    cv2.setRNGSeed(0)
    end = start + rough.reshape(-1, 2)
    homography, _ = cv2.findHomography(start[sample], end[sample], cv2.USAC_MAGSAC, INLIER_PX, maxIters=5000)
    if homography is None:
        return None
    still = cv2.warpPerspective(there, homography, (width, height), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    left = np.asarray(fine.calc(here, np.asarray(still), no_guess(here)), np.float32)
    end = cv2.perspectiveTransform((start + left.reshape(-1, 2))[None], homography)[0]
    away = np.linalg.norm(left, axis=2)
    F, _ = cv2.findFundamentalMat(start[sample], end[sample], cv2.USAC_MAGSAC, INLIER_PX, 0.999, 5000)
    if F is not None and F.shape == (3, 3):
        away = np.minimum(away, sampson(F, start, end).reshape(height, width))
    seen = (end >= 0).all(axis=1) & (end[:, 0] <= width - 1) & (end[:, 1] <= height - 1)
    return np.where(seen.reshape(height, width), away, 0.0).astype(np.float32), left


def rough_flow() -> cv2.DISOpticalFlow:
    return cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)


def fine_flow() -> cv2.DISOpticalFlow:
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    flow.setFinestScale(0)  # a car can be ten pixels long
    return flow


def no_guess(picture: NDArray[np.uint8]) -> Floats:
    return np.zeros((*picture.shape, 2), np.float32)


def sampson(F: NDArray[np.float64], start: Floats, end: Floats) -> NDArray[np.float64]:
    """Distance [N] in pixels of pairs [N, 2] from epipolar geometry, to first order (Hartley and Zisserman, 11.9)."""
    x0 = np.concatenate([start, np.ones((len(start), 1))], axis=1).astype(np.float64)
    x1 = np.concatenate([end, np.ones((len(end), 1))], axis=1).astype(np.float64)
    lines0, lines1 = x0 @ F.T, x1 @ F
    algebraic = (x1 * lines0).sum(axis=1)
    gradient = (lines0[:, :2] ** 2).sum(axis=1) + (lines1[:, :2] ** 2).sum(axis=1)
    distance: NDArray[np.float64] = np.abs(algebraic) / np.sqrt(np.maximum(gradient, 1e-12))
    return distance


def without_specks(mask: NDArray[np.uint8]) -> NDArray[np.uint8]:
    count, labels, statistics, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    keep = statistics[:, cv2.CC_STAT_AREA] >= max(MIN_PATCH_FRACTION * mask.size, 9)
    keep[0] = False
    return np.asarray(keep[labels] if count > 1 else mask * 0, np.uint8)


def without_bare(mask: NDArray[np.uint8], picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Patches of a mask that show something, unlike those of the sky, in which any motion is a guess."""
    contrast = cv2.GaussianBlur(np.abs(cv2.Laplacian(picture, cv2.CV_32F)), (0, 0), CONTRAST_AROUND_PX)
    count, labels, statistics, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    textured = np.bincount(labels[contrast > LEAST_CONTRAST], minlength=count)
    keep = textured >= LEAST_TEXTURED * statistics[:, cv2.CC_STAT_AREA]
    keep[0] = False
    return np.asarray(keep[labels], np.uint8)
