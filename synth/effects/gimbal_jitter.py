"""The gimbal does not hold the camera still: slow wander and fast vibration, both band-limited."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from synth.band_limited import BandLimited, band_limited
from synth.camera import invert_rigid
from synth.checking import key
from synth.rotations import rotation
from synth.seeds import generator

STAGE = "pose"
COST = "nothing"
TRUTH = "the true poses contain it"

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Settings:
    wander_deg: float = key(
        "root mean square of the slow part on each axis", unit="degrees", range=(0, 10), default=0.1
    )
    wander_hz: tuple[float, float] = key("band of the slow part", unit="1/s", range=(0, 10), default=(0.1, 2.0))
    vibration_deg: float = key("root mean square of the fast part", unit="degrees", range=(0, 5), default=0.01)
    vibration_hz: tuple[float, float] = key("band of the fast part", unit="1/s", range=(1, 500), default=(20.0, 80.0))


@dataclass(frozen=True)
class Jittering:
    """A flight whose camera turns a little about its own axes."""

    flight: Any
    parts: tuple[BandLimited, ...]  # radians about x, y, z of the camera

    def camera_to_world(self, time_s: float) -> Array:
        pose = np.array(self.flight.camera_to_world(time_s))
        pose[:3, :3] = pose[:3, :3] @ rotation(np.sum([part(time_s) for part in self.parts], axis=0))
        return pose

    def viewmat(self, time_s: float) -> Array:
        return invert_rigid(self.camera_to_world(time_s))


def fly(settings: Settings, flight: Any, seed: int) -> Jittering:
    wander = (generator(seed, "gimbal wander"), 3, math.radians(settings.wander_deg), settings.wander_hz)
    vibration = (generator(seed, "gimbal vibration"), 3, math.radians(settings.vibration_deg), settings.vibration_hz)
    return Jittering(flight, (band_limited(*wander), band_limited(*vibration)))
