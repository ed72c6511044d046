"""What `aa4d capture` can be told, and its presets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from aa4d.capture.schema import FARTHEST_M, MAX_SIDE_PX
from aa4d.settings.allowed import NameIn, Range, Share

USUAL_FPS = 30.0
USUAL_MOST_FRAMES = 150
CAMERA_MODELS = ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV")  # COLMAP's names
MOVERS = ("auto", "twice", "off")
OVERLAYS = ("tell", "leave-out")
MOST_THREADS = 256  # more than cores on nearly all machines; what a system cannot start ends the whole process

Number = Annotated[int, Range(1, 10_000)]
PerSecond = Annotated[float, Range(1e-3, 1e6)]
Seconds = Annotated[float, Range(0, 1e9)]
Meters = Annotated[float, Range(1e-3, FARTHEST_M)]
Degrees = Annotated[float, Range(1, 150)]
Pixels = Annotated[int, Range(64, MAX_SIDE_PX)]
Grays = Annotated[float, Range(0, 255)]


@dataclass(frozen=True)
class Selection:
    """Which frames of the input are used."""

    rate: PerSecond | None = None  # frames per second to keep; None: as many as `most_frames` allows
    start_s: Seconds = 0.0  # of the input, to begin at
    end_s: Seconds | None = None  # of the input, to end at
    max_frames: Annotated[int, Range(3, 1_000_000)] | None = None  # to use at most, evenly over the range; None: 150
    source_fps: PerSecond | None = None  # of a folder of frames, which does not say it; None: 30
    longest_px: Pixels = 1600  # frames are made smaller than that
    blurred_below: Share = 0.35  # share of its neighbors' sharpness below which a frame is left out; 0: none is
    duplicate_below: Grays = 0.4  # mean gray-level difference from the frame before; 0: only identical ones

    def __post_init__(self) -> None:
        if self.end_s is not None and not self.end_s > self.start_s:
            raise ValueError(f"the end, {self.end_s:g} s, must lie after the start, {self.start_s:g} s")

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

    longest_px: Pixels  # of the pictures that features are found in
    features: Annotated[int, Range(100, 100_000)]  # at most, a frame
    window: Number  # every frame is matched with that many frames after it, and with those 2, 4, 8, ... times as far
    keyframes: Number  # loop closure: so many frames, evenly over the clip, are matched each with each
    camera_model: Annotated[str, NameIn(__name__, "CAMERA_MODELS")]  # of the lens, COLMAP's name
    global_refinements: Number  # of bundle adjustment over all frames, each time it runs
    grown_by: Annotated[float, Range(1.01, 10)]  # it runs whenever frames or points have grown by that factor


@dataclass(frozen=True)
class CaptureSettings:
    preset: str  # where the other settings start from
    reconstruction: Reconstruction
    selection: Selection = Selection()
    movers: Annotated[str, NameIn(__name__, "MOVERS")] = "auto"  # twice: adds what was missed, with cameras known
    # Of what is burned into the pictures. Told: a finding that is wrong costs nothing, a mask would cost every frame.
    overlay: Annotated[str, NameIn(__name__, "OVERLAYS")] = "tell"
    size_px: Pixels = 1280  # longest side of the capture's frames, at most
    fov_deg: Degrees | None = None  # horizontal field of view of the frames, where it is known
    altitude_m: Meters | None = None  # median distance from cameras to what they see, where no GNSS gives the scale
    seed: Annotated[int, Range(0, 2**31 - 1)] = 0  # of everything random
    threads: Annotated[int, Range(1, MOST_THREADS)] = 2  # by default one for each core


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
