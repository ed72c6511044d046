"""The drone sways about its path in the wind: a slow, band-limited motion, continuous between frames."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from synth.band_limited import BandLimited, band_limited
from synth.camera import invert_rigid
from synth.checking import key
from synth.seeds import generator

STAGE = "pose"
COST = "nothing"
TRUTH = "the true poses contain it"


@dataclass(frozen=True, kw_only=True)
class Settings:
    rms_m: float = key("root mean square on each axis", unit="meters", range=(0, 10), default=0.1)
    band_hz: tuple[float, float] = key("slowest and fastest part", unit="1/s", range=(0, 20), default=(0.1, 0.5))


@dataclass(frozen=True)
class Swaying:
    """A flight that sways about another."""

    flight: Any
    sway_m: BandLimited

    def camera_to_world(self, time_s: float) -> NDArray[np.float64]:
        pose = np.array(self.flight.camera_to_world(time_s))
        pose[:3, 3] += self.sway_m(time_s)
        return pose

    def viewmat(self, time_s: float) -> NDArray[np.float64]:
        return invert_rigid(self.camera_to_world(time_s))


def fly(settings: Settings, flight: Any, seed: int) -> Swaying:
    return Swaying(flight, band_limited(generator(seed, "position sway"), 3, settings.rms_m, settings.band_hz))
