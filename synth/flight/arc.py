"""Arc: constant altitude, radius and angular rate about a centre that the camera looks at."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from synth.flight import keys
from synth.flight.orientation import orientation, pose

Array = NDArray[np.float64]
Place = tuple[float, float, float]


def around(centre: Place, radius_m: float, altitude_m: float, angle: float) -> Array:
    """Pose on a circle, looking at its centre. At radius zero the camera looks straight down and its yaw follows the
    angle: the same continuous family."""
    pitch = -math.atan2(altitude_m - centre[2], radius_m)
    position = np.array([centre[0] + radius_m * math.cos(angle), centre[1] + radius_m * math.sin(angle), altitude_m])
    return pose(orientation(angle + math.pi, pitch), position)


@dataclass(frozen=True, kw_only=True)
class Arc:
    """Constant altitude and angular rate about a center that the camera looks at."""

    kind: Literal["arc"] = "arc"
    centre_m: Place = keys.centre()
    radius_m: float = keys.radius("horizontal distance from the center; 0 turns on the spot, looking straight down")
    altitude_m: float = keys.altitude()
    start_deg: float = keys.angle("where the drone is at the first frame, seen from the center")
    sweep_deg: float = keys.angle("angle flown from the first to the last frame; may exceed 360")

    def camera_to_world(self, share: float) -> Array:
        angle = math.radians(self.start_deg + self.sweep_deg * share)
        return around(self.centre_m, self.radius_m, self.altitude_m, angle)

    def problem(self) -> str | None:
        return "altitude_m: must be above the center" if self.altitude_m <= self.centre_m[2] else None
