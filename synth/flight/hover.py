"""Hover: one place, looking one way, or turning on the spot."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from synth.flight import keys
from synth.flight.arc import Place
from synth.flight.orientation import orientation, pose

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Hover:
    """One place: without a sweep the clip has no baseline at all."""

    kind: Literal["hover"] = "hover"
    position_m: Place = keys.place("where the drone hovers")
    yaw_deg: float = keys.angle("where it looks, counter-clockwise from east; straight down: what is up in the picture")
    pitch_deg: float = keys.pitch()
    sweep_deg: float = keys.angle("how far it turns on the spot from the first to the last frame", 0.0)

    def camera_to_world(self, share: float) -> Array:
        yaw = math.radians(self.yaw_deg + self.sweep_deg * share)
        return pose(orientation(yaw, math.radians(self.pitch_deg)), np.array(self.position_m))

    def problem(self) -> str | None:
        return (
            "position_m: must be above the ground, its third number is the altitude" if self.position_m[2] < 1 else None
        )
