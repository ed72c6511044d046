"""Spiral: an arc whose radius and altitude change evenly."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from synth.checking import key
from synth.flight import keys
from synth.flight.arc import Place, around

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Spiral:
    """An arc whose radius and altitude change evenly from the first to the last frame."""

    kind: Literal["spiral"] = "spiral"
    centre_m: Place = keys.centre()
    radius_m: tuple[float, float] = key("[first, last] horizontal distance from the center", unit="m", range=(0, 2000))
    altitude_m: tuple[float, float] = key("[first, last] height above the ground", unit="m", range=(1, 2000))
    start_deg: float = keys.angle("where the drone is at the first frame, seen from the center")
    sweep_deg: float = keys.angle("angle flown from the first to the last frame")

    def camera_to_world(self, share: float) -> Array:
        (r0, r1), (z0, z1) = self.radius_m, self.altitude_m
        angle = math.radians(self.start_deg + self.sweep_deg * share)
        return around(self.centre_m, r0 + (r1 - r0) * share, z0 + (z1 - z0) * share, angle)

    def problem(self) -> str | None:
        return "altitude_m: must be above the center" if min(self.altitude_m) <= self.centre_m[2] else None
