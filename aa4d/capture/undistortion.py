"""From the reconstructed camera, with its lens distortion, to one pinhole camera for all frames.

The pinhole camera sees the largest upright rectangle that every frame fills, at the true principal point: the
rectangle is cut where the lens ends, not centred.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from aa4d.capture.clip import Clip
from aa4d.capture.movers import Masks, mask_path, read_mask
from aa4d.capture.pictures import read_picture, save_png
from aa4d.capture.schema import PinholeCamera
from aa4d.capture.workspace import Progress, Step, StepResult

Floats = NDArray[np.float64]
OUTLINE_POINTS = 9  # on each edge of a box: under distortion it is no rectangle


@dataclass(frozen=True)
class Pictures(StepResult):
    """NAME.png of every frame of the capture, and NAME.mask.png where there are masks: white is what moves."""


def pictures_step(
    clip: Clip, ranks: list[int], cameras: list[Any], pinhole: PinholeCamera, masks: Masks | None, size_px: int
) -> Step[Pictures]:
    """Undistort the frames of these ranks in the clip, each taken by one of `cameras` (COLMAP's)."""
    return Step(
        "pictures", [size_px], lambda *place: write_pictures(clip, ranks, cameras, pinhole, masks, *place), Pictures
    )


def write_pictures(
    clip: Clip,
    ranks: list[int],
    cameras: list[Any],
    pinhole: PinholeCamera,
    masks: Masks | None,
    folder: Path,
    progress: Progress,
) -> Pictures:
    """Write what is not there yet: a frame's picture comes after its mask."""
    maps: dict[int, Undistortion] = {}
    for done, (rank, camera) in enumerate(zip(ranks, cameras, strict=True), 1):
        if camera.camera_id not in maps:
            maps[camera.camera_id] = Undistortion(camera, pinhole)
        undistortion, frame = maps[camera.camera_id], clip.frames[rank]
        target = folder / f"{Path(frame.file).stem}.png"
        if not target.exists():
            if masks is not None:
                moving = read_mask(mask_path(masks.folder, frame.file))
                white = np.where(moving, 255, 0).astype(np.uint8)
                save_png(target.with_suffix(".mask.png"), undistortion.mask(white))
            save_png(target, undistortion.picture(clip.folder / frame.file))
        progress(done, len(ranks))
    return Pictures(folder)


def pinhole_of(cameras: list[Any], size_px: int) -> PinholeCamera:
    """The pinhole camera whose pixels all of `cameras` (COLMAP's) see, `size_px` on its longest side at most."""
    lefts, tops, rights, bottoms = np.array([_rectangle(camera) for camera in cameras]).T
    left, top, right, bottom = lefts.max(), tops.max(), rights.min(), bottoms.min()
    focal_x = float(np.median([c.focal_length_x for c in cameras]))
    focal_y = float(np.median([c.focal_length_y for c in cameras]))
    shrink = min(1.0, size_px / max((right - left) * focal_x, (bottom - top) * focal_y))
    # A hair more, so that a rectangle of exactly so many pixels keeps the last.
    width = int((right - left) * focal_x * shrink + 1e-6)
    height = int((bottom - top) * focal_y * shrink + 1e-6)
    fx, fy = focal_x * shrink, focal_y * shrink
    return PinholeCamera(width, height, np.array([[fx, 0, -left * fx], [0, fy, -top * fy], [0, 0, 1.0]]))


def _rectangle(camera: Any) -> tuple[float, float, float, float]:
    """Left, top, right and bottom of the rectangle inside the picture's outline, on the plane at depth 1."""
    w, h = camera.width, camera.height
    across, down = np.linspace(0, w, 65), np.linspace(0, h, 65)

    def on_plane(x: Any, y: Any) -> Floats:
        pixels = np.stack(np.broadcast_arrays(x, y), axis=-1).astype(np.float64)
        found: Floats = np.asarray(camera.cam_from_img(pixels))
        return found

    return (
        float(on_plane(0.0, down)[:, 0].max()),
        float(on_plane(across, 0.0)[:, 1].max()),
        float(on_plane(float(w), down)[:, 0].min()),
        float(on_plane(across, float(h))[:, 1].min()),
    )


class Undistortion:
    """Frames of one COLMAP camera as the pinhole camera sees them."""

    def __init__(self, camera: Any, pinhole: PinholeCamera) -> None:
        self._pinhole = pinhole
        # Picture elements that the pinhole camera makes much smaller are averaged first, or they would flicker.
        shrink = min(1.0, pinhole.K[0, 0] / camera.focal_length_x)
        self._size = (max(round(camera.width * shrink), 1), max(round(camera.height * shrink), 1))
        columns, rows = np.meshgrid(np.arange(pinhole.width) + 0.5, np.arange(pinhole.height) + 0.5)
        K = pinhole.K
        rays = np.stack([(columns - K[0, 2]) / K[0, 0], (rows - K[1, 2]) / K[1, 1], np.ones_like(rows)], axis=-1)
        pixels = np.asarray(camera.img_from_cam(rays.reshape(-1, 3))).reshape(*columns.shape, 2)
        # OpenCV's pixel centres are whole numbers.
        scale = np.array([self._size[0] / camera.width, self._size[1] / camera.height])
        self._map = (pixels * scale - 0.5).astype(np.float32)
        identity = np.stack([columns, rows], axis=-1) - 0.5
        self._is_identity = self._size == (pinhole.width, pinhole.height) and bool(
            np.abs(self._map - identity).max() < 1e-3
        )

    def picture(self, path: Path) -> NDArray[np.uint8]:
        """[H, W, 3]"""
        return self.sampled(read_picture(path))

    def mask(self, mask: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """[H, W], with no values between those that it has."""
        return self.sampled(mask, cv2.INTER_NEAREST, cv2.INTER_NEAREST)

    def sampled(
        self, pixels: NDArray[np.uint8], shrinking: int = cv2.INTER_AREA, sampling: int = cv2.INTER_LINEAR
    ) -> NDArray[np.uint8]:
        """[H, W, ...] from a frame of the COLMAP camera, of any size."""
        if (pixels.shape[1], pixels.shape[0]) != self._size:
            pixels = np.asarray(cv2.resize(pixels, self._size, interpolation=shrinking), np.uint8)
        if self._is_identity:
            return pixels
        sampled = cv2.remap(pixels, self._map[..., 0], self._map[..., 1], sampling, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(sampled, np.uint8)


def pinhole_pixels(camera: Any, pinhole: PinholeCamera, pixels: Floats) -> Floats:
    """Places in the pinhole picture of pixels [M, 2] of a COLMAP camera."""
    rays: Floats = np.asarray(camera.cam_from_img(pixels))
    on_picture: Floats = rays * [pinhole.K[0, 0], pinhole.K[1, 1]] + [pinhole.K[0, 2], pinhole.K[1, 2]]
    return on_picture


def pinhole_boxes(camera: Any, pinhole: PinholeCamera, boxes: Floats, source_size: tuple[int, int]) -> Floats:
    """[M, 4] left, top, right, bottom in the pinhole picture: around what the boxes' outlines become there.

    Args:
        boxes: [M, 4] left, top, width, height in a picture of `source_size` (width, height) by the COLMAP camera. What
            lies outside of the picture is cut off first: the lens is not known there.
    """
    edges = np.concatenate([boxes[:, :2], boxes[:, :2] + boxes[:, 2:]], axis=1)
    edges = np.clip(edges, 0, np.array([*source_size, *source_size])) * (
        np.array([camera.width, camera.height] * 2) / np.array([*source_size, *source_size])
    )
    along = np.linspace(0, 1, OUTLINE_POINTS)
    x = edges[:, :1] + along * (edges[:, 2:3] - edges[:, :1])
    y = edges[:, 1:2] + along * (edges[:, 3:] - edges[:, 1:2])
    left, top, right, bottom = (np.repeat(edges[:, [k]], OUTLINE_POINTS, axis=1) for k in range(4))
    outline = np.stack([np.concatenate([x, x, left, right], axis=1), np.concatenate([top, bottom, y, y], axis=1)], -1)
    seen = pinhole_pixels(camera, pinhole, outline.reshape(-1, 2)).reshape(len(boxes), 4 * OUTLINE_POINTS, 2)
    around = np.concatenate([seen.min(axis=1), seen.max(axis=1)], axis=1)
    return np.clip(around, 0, [pinhole.width, pinhole.height] * 2)


def viewmat_of(image: Any) -> Floats:
    """World to camera [4, 4] of a COLMAP image."""
    matrix = np.eye(4)
    matrix[:3] = image.cam_from_world().matrix()
    return matrix
