"""What `aa4d capture` can be told, and its presets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

USUAL_FPS = 30.0
USUAL_MOST_FRAMES = 150


@dataclass(frozen=True)
class Selection:
    """Which frames of the input are used."""

    rate: float | None = None  # frames per second to keep; None: as many as `most_frames` allows
    start_s: float = 0.0
    end_s: float | None = None
    max_frames: int | None = None  # None: USUAL_MOST_FRAMES
    source_fps: float | None = None  # of a folder of frames, which does not say it: None is USUAL_FPS
    longest_px: int = 1600  # frames are made smaller than that
    blurred_below: float = 0.35  # share of its neighbours' sharpness below which a frame is left out; 0: none is
    duplicate_below: float = 0.4  # mean grey-level difference from the frame before; 0: only identical ones

    @property
    def most_frames(self) -> int:
        return USUAL_MOST_FRAMES if self.max_frames is None else self.max_frames

    @property
    def is_open(self) -> bool:
        """Whether nobody has said which frames to use."""
        return self.rate is None and self.start_s == 0 and self.end_s is None and self.max_frames is None

    @property
    def folder_fps(self) -> float:
        return USUAL_FPS if self.source_fps is None else self.source_fps

    def ignored_fps(self, source: str) -> list[str]:
        """A note where a rate was stated for a `source` that says its own times."""
        return [] if self.source_fps is None else [f"--fps {self.source_fps:g} is ignored: {source} says its own times"]


@dataclass(frozen=True)
class Reconstruction:
    """Structure from motion: what accuracy costs in time is decided here."""

    longest_px: int  # of the pictures that features are found in
    features: int  # at most, a frame
    window: int  # every frame is matched with that many frames after it, and with those 2, 4, 8, ... times as far
    keyframes: int  # loop closure: so many frames, evenly over the clip, are matched each with each
    camera_model: str  # COLMAP's name
    global_refinements: int  # of bundle adjustment over all frames, each time it runs
    grown_by: float  # it runs whenever frames or points have grown by that factor


@dataclass(frozen=True)
class CaptureSettings:
    preset: str
    reconstruction: Reconstruction
    selection: Selection = Selection()
    movers: Literal["auto", "off"] = "auto"
    size_px: int = 1280  # longest side of the capture's frames, at most
    fov_deg: float | None = None  # horizontal field of view of the frames, where it is known
    altitude_m: float | None = None  # median distance from cameras to what they see, where no GNSS gives the scale
    seed: int = 0
    threads: int = 2


PRESETS = {
    "fast": Reconstruction(
        longest_px=800,
        features=2000,
        window=3,
        keyframes=8,
        camera_model="SIMPLE_RADIAL",
        global_refinements=2,
        grown_by=1.5,
    ),
    "accurate": Reconstruction(
        longest_px=1600,
        features=6000,
        window=8,
        keyframes=24,
        camera_model="RADIAL",
        global_refinements=5,
        grown_by=1.1,
    ),
}
