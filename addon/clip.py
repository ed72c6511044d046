"""What every file that can be shown says of its capture: frame rate, camera, frames, background. No bpy here.

A clip plays by its clock, in frames of `fps`: where the seconds of its frames are not evenly apart, some of the clock's
frames lie between two of the clip's. A rank is a (fractional) frame of that clock, from 0.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .header import FASTEST_FPS, Camera, Doubles, array, number, pinhole, poses_images_and_seconds, require

UNEVEN = 0.01  # share by which the mean step may differ from that of the rate
JITTER = 0.1  # frames by which one may be early or late: seconds are often rounded to milliseconds
LONGEST_CLIP = 1_000_000  # frames of its clock: what Blender's timeline holds


@dataclass(frozen=True)
class Clip:
    """The clip that a file was trained on."""

    path: Path  # of the file
    fps: float
    camera: Camera
    viewmats: Doubles  # [frames, 4, 4], world to camera, in presentation order
    images: tuple[str, ...]  # of the frames, relative to the capture
    held_out: npt.NDArray[np.bool_]  # [frames] those that were not trained on
    ranks: Doubles  # [frames] of the frames, rising from 0; whole numbers where they are evenly apart
    capture: str | None  # the capture's folder, relative to the file
    background: tuple[float, float, float]  # sRGB

    @property
    def frame_count(self) -> int:
        """The number of frames of the clip's clock."""
        return math.ceil(self.ranks[-1] - JITTER) + 1

    @property
    def is_even(self) -> bool:
        """Whether the clock has the clip's frames and no others."""
        return self.frame_count == len(self.ranks) and bool((self.ranks % 1 == 0).all())

    @property
    def camera_centers(self) -> Doubles:
        """Centres [frames, 3] of the capture's cameras, world metres."""
        return -np.einsum("nji,nj->ni", self.viewmats[:, :3, :3], self.viewmats[:, :3, 3])

    def time_of_rank(self, rank: float) -> float:
        """The t of a rank, in [0, 1]: the first and last frame hold outside the clip."""
        last = len(self.ranks) - 1
        if not last:
            return 0.0
        if self.is_even:
            return min(max(rank / last, 0.0), 1.0)
        return float(np.interp(rank, self.ranks, np.arange(last + 1)) / last)

    def seconds_between(self, before: float, after: float) -> float:
        """How long it takes from one t to a later one."""
        last = len(self.ranks) - 1
        if self.is_even:
            return (after - before) * last / self.fps
        begin, end = np.interp([before * last, after * last], np.arange(last + 1), self.ranks)
        return float(end - begin) / self.fps

    def camera_center_at(self, t: float) -> Doubles:
        """The capture camera's centre [3] in world metres at time t, linear between frames."""
        frames = np.arange(len(self.viewmats))
        return np.array([np.interp(t * frames[-1], frames, axis) for axis in self.camera_centers.T])


def read_clip(path: Path, information: Mapping[str, Any]) -> Clip:
    """The clip in a file's `aa4d` metadata.

    Raises:
        ValueError, OverflowError, KeyError, TypeError, AttributeError: as in `header`.
    """
    fps = number(information["fps"], "fps")
    require(0 < fps <= FASTEST_FPS, f"fps must lie in (0, {FASTEST_FPS:g}]")
    camera = pinhole(information["camera"])
    viewmats, images, seconds = poses_images_and_seconds(information["frames"])
    ranks = (seconds - seconds[0]) * fps
    require(ranks[-1] < LONGEST_CLIP, f"time_s must span fewer than {LONGEST_CLIP:,} frames of the clip's rate")
    whole = np.arange(len(ranks), dtype=np.float64)
    step = ranks[-1] / max(whole[-1], 1)
    if (len(ranks) == 1 or abs(step - 1) < UNEVEN) and (np.abs(ranks - step * whole) < JITTER).all():
        ranks = whole
    background = array(information["background"], (3,), "background")
    require(((background >= 0) & (background <= 1)).all(), "background must lie in [0, 1]")
    capture = information["capture"]
    require(capture is None or isinstance(capture, str), "capture must be a path or null")
    held_out = np.array([frame["split"] == "test" for frame in information["frames"]])
    red, green, blue = background.tolist()
    return Clip(path, fps, camera, viewmats, images, held_out, ranks, capture, (red, green, blue))
