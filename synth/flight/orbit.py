"""Orbit: whole turns about a centre."""

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
class Orbit:
    """Turns about a center that the camera looks at; after a whole turn the first view comes again."""

    kind: Literal["orbit"] = "orbit"
    centre_m: Place = keys.centre()
    radius_m: float = keys.radius("horizontal distance from the center")
    altitude_m: float = keys.altitude()
    start_deg: float = keys.angle("where the drone is at the first frame, seen from the center", 0.0)
    turns: float = key("turns from the first to the last frame, counter-clockwise; negative flies clockwise",
                       range=(-20, 20), default=1.0)  # fmt: skip

    def camera_to_world(self, share: float) -> Array:
        angle = math.radians(self.start_deg) + 2 * math.pi * self.turns * share
        return around(self.centre_m, self.radius_m, self.altitude_m, angle)

    def problem(self) -> str | None:
        return "altitude_m: must be above the center" if self.altitude_m <= self.centre_m[2] else None
