"""The drone's flights. A flight is one file here and one entry in `FLIGHTS`: a checked dataclass of its keys with
`camera_to_world(share)`, the exact float64 pose [4, 4] (OpenCV axes) at a share of the clip's duration."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from synth.camera import invert_rigid
from synth.flight.arc import Arc
from synth.flight.hover import Hover
from synth.flight.line import Line
from synth.flight.orbit import Orbit
from synth.flight.orientation import look_at, orientation
from synth.flight.spiral import Spiral
from synth.flight.waypoints import Waypoints

__all__ = ["FLIGHTS", "Flight", "Trajectory", "look_at", "orientation"]

Array = NDArray[np.float64]


class Flight(Protocol):
    """What every flight can do."""

    @property
    def kind(self) -> str: ...

    def camera_to_world(self, share: float) -> Array:
        """Pose [4, 4] when the share of the clip has passed: 0 at the first frame, 1 at the last, any real between."""
        ...

    def problem(self) -> str | None:
        """What makes the flight impossible, as "key: sentence"; None when it is sound."""
        ...


FLIGHTS: dict[str, type] = {
    "arc": Arc,
    "orbit": Orbit,
    "line": Line,
    "hover": Hover,
    "spiral": Spiral,
    "waypoints": Waypoints,
}


@dataclass(frozen=True)
class Trajectory:
    """A flight over the time of a clip: an exact pose at any real time, frames or not."""

    flight: Flight
    duration_s: float

    def camera_to_world(self, time_s: float) -> Array:
        """Pose [4, 4] at a real time, OpenCV axes. A clip without duration stays at the flight's start."""
        return self.flight.camera_to_world(time_s / self.duration_s if self.duration_s > 0 else 0.0)

    def viewmat(self, time_s: float) -> Array:
        """World to camera [4, 4]."""
        return invert_rigid(self.camera_to_world(time_s))
