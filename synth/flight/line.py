"""Line: straight from one place to another at constant speed."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from synth.flight import keys
from synth.flight.arc import Place
from synth.flight.orientation import look_at, orientation, pose

Array = NDArray[np.float64]


NEAR_NADIR = math.tan(math.radians(10))


@dataclass(frozen=True, kw_only=True)
class Line:
    """A straight line at constant speed, with a fixed view or towards a target, which it may pass right above."""

    kind: Literal["line"] = "line"
    from_m: Place = keys.place("where the drone is at the first frame")
    to_m: Place = keys.place("where it is at the last frame")
    target_m: Place | None = keys.place("what it looks at; without it the view is fixed", None)
    yaw_deg: float | None = keys.angle(
        "fixed view: where it looks, by default along the line; with a target: the heading that is up at nadir, by "
        "default the direction of flight where the line passes above it, else the horizon is level",
        None,
    )
    pitch_deg: float = keys.pitch(-45.0)

    def camera_to_world(self, share: float) -> Array:
        start, end = np.array(self.from_m), np.array(self.to_m)
        position = start + (end - start) * share
        along = end - start
        yaw = math.atan2(along[1], along[0]) if self.yaw_deg is None else math.radians(self.yaw_deg)
        if self.target_m is None:
            return pose(orientation(yaw, math.radians(self.pitch_deg)), position)
        target = np.array(self.target_m)
        level = self.yaw_deg is None and not _passes_above(start, end, target)
        return pose(look_at(position, target, None if level else yaw), position)

    def problem(self) -> str | None:
        if min(self.from_m[2], self.to_m[2]) < 1:
            return "from_m, to_m: must be above the ground, the third number is the altitude"
        if self.target_m is not None and self.target_m[2] >= min(self.from_m[2], self.to_m[2]):
            return "target_m: must be below the drone"
        return None


def _passes_above(start: Array, end: Array, target: Array) -> bool:
    """Whether the line comes so near to the vertical through the target that a level horizon would spin."""
    along, offset = (end - start)[:2], (target - start)[:2]
    share = float(np.clip(along @ offset / max(float(along @ along), 1e-12), 0.0, 1.0))
    closest = start + (end - start) * share - target
    return bool(np.hypot(closest[0], closest[1]) < NEAR_NADIR * closest[2])
