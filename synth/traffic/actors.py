"""Road users while they are simulated: what of them changes from step to step."""

import bisect
import math
from dataclasses import dataclass

import numpy as np

from synth.traffic.following import ballistic
from synth.traffic.network import Network
from synth.traffic.paths import Path, Shift

STRAIGHT = Shift(0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Wait:
    """Where a walker waits, and the crossing behind it from kerb to kerb: arc lengths on its path."""

    at_m: float
    kerb_m: float
    end_m: float
    crossing: int


class Car:
    """A vehicle on its route. Positions are arc lengths of its centre; `starts` are those of its lanes, and the end."""

    def __init__(self, number: int, kind: str, half: float, cruise: float, network: Network, route: str) -> None:
        self.number, self.kind, self.half, self.cruise = number, kind, half, cruise
        self.position, self.speed = 0.0, 0.0
        self.granted = -1  # the last junction lane, as an index into the route, that it may enter
        self.shift = STRAIGHT
        self.beside: str | None = None  # the lane that it is leaving sideways, which it still occupies
        self.enters_s = -math.inf
        self.leaves_s = math.inf  # parked until then
        self.hold_s = -math.inf  # may enter no junction before
        self.stop_m = math.inf  # where its centre stops for good
        self.gap, self.leader_speed = math.inf, 0.0
        self.present = False
        self.parked = False  # stands in a bay, out of everybody's way
        self.slow_m = (math.inf, -math.inf)  # from where to where it manoeuvres: arc lengths
        self.through = False  # drives on behind its route's end
        self.take(network, route)

    def take(self, network: Network, route: str) -> None:
        """Follow a route, or another one that runs beside the present one."""
        self.route_name, self.route = route, network.routes[route]
        self.starts = [0.0]
        for name in self.route:
            self.starts.append(self.starts[-1] + network.lanes[name].path.length_m)
        self.junctions = [k for k, name in enumerate(self.route) if network.lanes[name].junction]

    @property
    def front(self) -> float:
        return self.position + self.half

    @property
    def rear(self) -> float:
        return self.position - self.half

    def lane_at(self, position: float) -> int:
        """Index of the lane that holds an arc length."""
        return min(max(bisect.bisect_right(self.starts, position) - 1, 0), len(self.route) - 1)

    def next_junction(self) -> int | None:
        """The next junction lane that it has no grant for."""
        return next((k for k in self.junctions if k > self.granted), None)


EASY_STOP_MPS2 = 0.8  # of someone on foot


class Walker:
    """Someone on foot on a path, who may have to wait once."""

    def __init__(self, number: int, path: Path, position: float, cruise: float, wait: Wait | None) -> None:
        self.number, self.path, self.position, self.cruise, self.wait = number, path, position, cruise, wait
        self.speed = cruise
        self.crossing_now = False
        self.kerbs_m = (wait.kerb_m, wait.end_m) if wait else (math.nan, math.nan)

    def waiting(self) -> bool:
        """Is at the kerb, or about to be there, and has not set off."""
        return self.wait is not None and not self.crossing_now and 0 <= self.wait.at_m - self.position < 1.5

    def advance(self, step_s: float) -> float:
        """The acceleration of the next step."""
        if self.wait is not None:
            if self.position > self.wait.end_m:
                self.crossing_now, self.wait = False, None
            elif not self.crossing_now:
                left = self.wait.at_m - self.position
                if left < 0.02:
                    return -self.speed / step_s
                if self.speed**2 > 2 * EASY_STOP_MPS2 * left:
                    return -(self.speed**2) / (2 * left)
        return min((self.cruise - self.speed) / max(step_s, 0.3), 1.5)

    def move(self, acceleration: float, step_s: float) -> None:
        """Go on for one step."""
        position, speed = ballistic(np.array(self.position), np.array(self.speed), np.array(acceleration), step_s)
        self.position, self.speed = float(position), float(speed)
