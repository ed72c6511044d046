"""What every file that can be shown says of its capture: frame rate, camera, frames, background. No bpy here."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .header import FASTEST_FPS, Camera, Doubles, array, number, pinhole, poses_and_images, require


@dataclass(frozen=True)
class Clip:
    """The clip that a file was trained on."""

    path: Path  # of the file
    fps: float
    camera: Camera
    viewmats: Doubles  # [frames, 4, 4], world to camera, in presentation order
    images: tuple[str, ...]  # of the frames, relative to the capture
    capture: str | None  # the capture's folder, relative to the file
    background: tuple[float, float, float]  # sRGB

    @property
    def frame_count(self) -> int:
        """The number of frames of the clip."""
        return len(self.viewmats)

    @property
    def camera_centers(self) -> Doubles:
        """Centres [frames, 3] of the capture's cameras, world metres."""
        return -np.einsum("nji,nj->ni", self.viewmats[:, :3, :3], self.viewmats[:, :3, 3])

    def time_of_rank(self, rank: float) -> float:
        """The t of a (fractional) frame rank, in [0, 1]: the first and last frame hold outside the clip."""
        last = self.frame_count - 1
        return min(max(rank / last, 0.0), 1.0) if last else 0.0

    def camera_center_at(self, t: float) -> Doubles:
        """The capture camera's centre [3] in world metres at time t, linear between frames."""
        ranks = np.arange(self.frame_count)
        return np.array([np.interp(t * ranks[-1], ranks, axis) for axis in self.camera_centers.T])


def read_clip(path: Path, information: Mapping[str, Any]) -> Clip:
    """The clip in a file's `aa4d` metadata.

    Raises:
        ValueError, OverflowError, KeyError, TypeError, AttributeError: as in `header`.
    """
    fps = number(information["fps"], "fps")
    require(0 < fps <= FASTEST_FPS, f"fps must lie in (0, {FASTEST_FPS:g}]")
    camera = pinhole(information["camera"])
    viewmats, images = poses_and_images(information["frames"])
    background = array(information["background"], (3,), "background")
    require(((background >= 0) & (background <= 1)).all(), "background must lie in [0, 1]")
    capture = information["capture"]
    require(capture is None or isinstance(capture, str), "capture must be a path or null")
    red, green, blue = background.tolist()
    return Clip(path, fps, camera, viewmats, images, capture, (red, green, blue))
