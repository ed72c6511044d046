"""Drive the vehicles of a scene through its lanes, and answer where each is at any real time."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from synth.errors import InputError
from synth.spec import Signal, Traffic, Vehicle
from synth.traffic.fleet import BODIES
from synth.traffic.following import HARDEST_BRAKING_MPS2, ballistic, idm_acceleration
from synth.traffic.network import Network
from synth.traffic.paths import Path
from synth.traffic.signals import is_green

Array = NDArray[np.float64]

STOP_GAP_M = 0.5  # bumper to stop line when waiting
HOLD_M = 0.05  # this close to where it means to stop, a vehicle holds its brakes
EASY_BRAKING_MPS2 = 2.0  # braking for a red light starts when this would be needed
FIRM_BRAKING_MPS2 = 4.0  # who would need more than this to stop for a red light drives on, as drivers do


@dataclass(frozen=True)
class Drives:
    """The driven vehicles over time: piecewise quadratic positions along their routes.

    `times_s` [K] are the simulation's steps; `position_m`, `speed_mps`, `acceleration_mps2` are [K, M], at and just
    after each step. Positions are arc lengths of the body's centre along its route.
    """

    vehicles: tuple[Vehicle, ...]
    paths: tuple[Path, ...]
    times_s: Array
    position_m: Array
    speed_mps: Array
    acceleration_mps2: Array

    def state(self, time_s: float) -> tuple[Array, Array]:
        """Positions [M] and speeds [M] at a real time, exact between steps."""
        step = int(np.clip(np.searchsorted(self.times_s, time_s, side="right") - 1, 0, len(self.times_s) - 1))
        elapsed = time_s - self.times_s[step]
        return ballistic(self.position_m[step], self.speed_mps[step], self.acceleration_mps2[step], elapsed)

    def poses(self, time_s: float) -> tuple[Array, Array]:
        """Centres [M, 2] and headings [M] in radians at a real time."""
        position, _ = self.state(time_s)
        centres, headings = np.empty((len(self.paths), 2)), np.empty(len(self.paths))
        for i, (path, vehicle) in enumerate(zip(self.paths, self.vehicles, strict=True)):
            centres[i], headings[i] = path.axle_pose(position[i], BODIES[vehicle.kind].wheelbase_m)
        return centres, headings


def simulate(
    network: Network, vehicles: tuple[Vehicle, ...], signal: Signal | None, traffic: Traffic, duration_s: float
) -> Drives:
    """Integrate from time 0 to `duration_s`.

    Raises:
        InputError: two vehicles start inside each other.
    """
    paths = tuple(network.route_path(vehicle.route) for vehicle in vehicles)
    half = np.array([0.5 * BODIES[vehicle.kind].length_m for vehicle in vehicles])
    line = np.array([network.stop_line_m(vehicle.route) for vehicle in vehicles])
    cruise = np.array([vehicle.cruise_mps for vehicle in vehicles])
    arms = [vehicle.route.split("-")[0] for vehicle in vehicles]
    shared = _shared_offsets(network, vehicles)

    position = line + np.array([vehicle.position_m for vehicle in vehicles]) - half
    speed = np.array([vehicle.speed_mps for vehicle in vehicles])
    stopping = np.zeros(len(vehicles), dtype=bool)  # has decided to stop for the red light it sees
    was_green = np.ones(len(vehicles), dtype=bool)

    times = np.arange(0.0, duration_s + traffic.step_s, traffic.step_s)
    history: list[tuple[Array, Array, Array]] = []
    for time_s in times:
        green = np.array([is_green(signal, arm, float(time_s)) for arm in arms], dtype=bool)
        to_line = line - STOP_GAP_M - (position + half)
        with np.errstate(divide="ignore"):
            needed = np.where(to_line > 0, speed**2 / (2 * to_line), np.inf)
        stopping = ~green & np.where(was_green, needed <= FIRM_BRAKING_MPS2, stopping)
        was_green = green

        gap, closing = _leaders(position, speed, half, shared)
        if len(vehicles) and gap.min() < 0:
            follower = int(gap.argmin())
            raise InputError(
                f"vehicles[{follower}]: at {time_s:g} s it is {-gap[follower]:.1f} m inside the vehicle ahead; "
                "start it farther back or slower."
            )
        acceleration = idm_acceleration(speed, cruise, gap, closing, traffic)
        acceleration = np.where(stopping, np.minimum(acceleration, _braking(to_line, needed)), acceleration)
        history.append((position, speed, acceleration))
        position, speed = ballistic(position, speed, acceleration, traffic.step_s)
    positions, speeds, accelerations = (np.array(column) for column in zip(*history, strict=True))
    return Drives(vehicles, paths, times, positions, speeds, accelerations)


def _braking(to_line: Array, needed: Array) -> Array:
    """Acceleration [M] that ends at the stop line: evenly once it is worth braking, held when there.

    IDM's own approach to a standing obstacle creeps and never quite stops, which no driver does at a red light.
    """
    even = np.where(needed >= EASY_BRAKING_MPS2, -np.minimum(needed, HARDEST_BRAKING_MPS2), np.inf)
    return np.where(to_line <= HOLD_M, -HARDEST_BRAKING_MPS2, even)


def _shared_offsets(network: Network, vehicles: tuple[Vehicle, ...]) -> list[list[list[tuple[float, float, float]]]]:
    """For vehicles i and j, the lanes on both routes as (start on j, end on j, start on i minus start on j)."""
    spans = []
    for vehicle in vehicles:
        at, span = 0.0, {}
        names = network.routes[vehicle.route]
        for name in names:
            length = network.lanes[name].length_m
            # Routes begin before their first lane and go on behind their last one.
            low = -np.inf if name == names[0] else at
            high = np.inf if name == names[-1] else at + length
            span[name] = (low, high, at)
            at += length
        spans.append(span)
    return [
        [[(*there[name][:2], here[name][2] - there[name][2]) for name in here if name in there] for there in spans]
        for here in spans
    ]


def _leaders(
    position: Array, speed: Array, half: Array, shared: list[list[list[tuple[float, float, float]]]]
) -> tuple[Array, Array]:
    """Gap [M] to the rear bumper of the next vehicle on each one's route, and the closing speed [M]."""
    count = len(position)
    gap, closing = np.full(count, np.inf), np.zeros(count)
    for i in range(count):
        for j in range(count):
            rear = position[j] - half[j]
            for low, high, offset in shared[i][j] if i != j else ():
                ahead = position[j] + offset > position[i]
                distance = rear + offset - (position[i] + half[i])
                if low <= rear < high and ahead and distance < gap[i]:
                    gap[i], closing[i] = distance, speed[i] - speed[j]
    return gap, closing
