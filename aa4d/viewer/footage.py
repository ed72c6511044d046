"""The capture's own pictures, as a camera sees them that stands where one of them was taken."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from aa4d.capture.reader import Capture, read_image
from aa4d.capture.schema import Frame, PinholeCamera

REMEMBERED = 16  # pictures
FINEST = 2.0  # of a camera's sides, where the capture's pixels are far finer


@dataclass(frozen=True)
class Photo:
    """What a camera sees of a frame."""

    t: float  # of the frame
    pixels: NDArray[np.uint8]  # [H, W, 3]
    is_there: NDArray[np.bool_]  # [H, W], False beyond the frame's edges


class Footage:
    """Frames with the poses that the model was trained with, which may be refined."""

    def __init__(self, capture: Capture, frames: tuple[Frame, ...], tolerance_m: float) -> None:
        """`tolerance_m`: how far from a frame's camera its picture still fits."""
        self._camera, self._frames, self._tolerance_m = capture.camera, frames, tolerance_m
        self._picture = lru_cache(REMEMBERED)(lambda index: read_image(capture, capture.frames[index]))

    def as_sharp(self, camera: PinholeCamera) -> PinholeCamera:
        """A camera that sees the same with pixels as fine as the capture's: what is compared is not interpolated."""
        share = min(float(self._camera.K[0, 0] / camera.K[0, 0]), FINEST)
        width, height = max(round(camera.width * share), 1), max(round(camera.height * share), 1)
        scale = np.array([[width / camera.width], [height / camera.height], [1.0]])
        return PinholeCamera(width, height, camera.K * scale)

    def seen(self, viewmat: NDArray[np.float64], t: float, camera: PinholeCamera) -> Photo | None:
        """The picture of the frame nearest to t, as `camera` sees it; None where it stands elsewhere.

        Raises:
            InputError: the picture cannot be read.
        """
        index = nearest_frame(self._frames, t)
        frame = self._frames[index]
        if np.linalg.norm(_center(viewmat) - _center(frame.viewmat)) > self._tolerance_m:
            return None
        return turned(self._picture(index), frame, self._camera, viewmat, camera)


def nearest_frame(frames: tuple[Frame, ...], t: float) -> int:
    return int(np.argmin([abs(frame.t - t) for frame in frames]))


def turned(
    picture: NDArray[np.uint8],
    frame: Frame,
    taken_by: PinholeCamera,
    viewmat: NDArray[np.float64],
    camera: PinholeCamera,
) -> Photo:
    """A frame's picture as a camera at the same place sees it that may be turned, or of other intrinsics and size."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    pixels = np.stack([x, y, np.ones_like(x)], axis=-1)
    to_frame = taken_by.K @ frame.viewmat[:3, :3] @ viewmat[:3, :3].T @ np.linalg.inv(camera.K)
    source = pixels @ to_frame.T
    ahead = source[..., 2] > 1e-9
    at = source[..., :2] / np.where(ahead, source[..., 2], 1.0)[..., None]
    inside = ahead & (at >= 0).all(-1) & (at[..., 0] <= taken_by.width) & (at[..., 1] <= taken_by.height)
    # OpenCV's pixel centres are at whole numbers.
    at = np.where(inside[..., None], at - 0.5, -10.0).astype(np.float32)
    drawn = cv2.remap(picture, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return Photo(frame.t, np.where(inside[..., None], drawn, 0).astype(np.uint8), inside)


def _center(viewmat: NDArray[np.float64]) -> NDArray[np.float64]:
    return -viewmat[:3, :3].T @ viewmat[:3, 3]
