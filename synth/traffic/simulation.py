"""Move the road users of a scene through its lanes step by step, and answer where each is at any real time."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from synth.errors import InputError
from synth.traffic.actors import STRAIGHT, Car, Walker
from synth.traffic.fleet import BODIES
from synth.traffic.following import HARDEST_BRAKING_MPS2, ballistic, idm_acceleration, within_gap
from synth.traffic.lane_change import change_lanes
from synth.traffic.network import KERB_HEIGHT_M, Network
from synth.traffic.occupancy import Occupancy, leader, occupancy
from synth.traffic.paths import Path, Shift
from synth.traffic.right_of_way import EASY_BRAKING_MPS2, grant
from synth.traffic.settings import Traffic
from synth.traffic.signals import Intervals

Array = NDArray[np.float64]

STOP_GAP_M = 0.5  # bumper to stop line when waiting
HOLD_M = 0.05  # this close to where it means to stop, a vehicle holds its brakes
KERB_STEP_M = 0.4  # how far a step up or down a kerb reaches
MARGIN_S = 1.0  # simulated before the first and behind the last frame, for shutters and flow
PULL_OUT_M, PULL_IN_M = 7.5, 9.0  # how far along the street a vehicle goes while it leaves or enters a bay
MANOEUVRE_MPS = 3.0  # in and out of bays
BEND_BRAKING_MPS2 = 1.6  # slowing down for a bend


@dataclass(frozen=True)
class Drives:
    """Road users over time: piecewise quadratic positions along their paths, between steps as exact as at them.

    `times_s` [K] are the simulation's steps; `position_m`, `speed_mps`, `acceleration_mps2` are [K, M], at and just
    after each step: arc lengths of the body's centre along `paths[path_of[k, m]]`, moved sideways by `shifts[k, m]`
    (see `Shift`). `present` [K, M] is false before it comes and after it has gone.
    """

    kinds: tuple[str, ...]
    paths: tuple[Path, ...]
    levels_m: Array  # [M] height of the ground under each
    kerbs_m: Array  # [M, 2] where a walker steps down to the road and up again, arc lengths; NaN: never
    times_s: Array
    position_m: Array
    speed_mps: Array
    acceleration_mps2: Array
    path_of: NDArray[np.int64]
    shifts: Array  # [K, M, 4]
    present: NDArray[np.bool_]

    def step_at(self, time_s: float) -> int:
        return int(np.clip(np.searchsorted(self.times_s, time_s, side="right") - 1, 0, len(self.times_s) - 1))

    def state(self, time_s: float) -> tuple[Array, Array]:
        """Positions [M] and speeds [M] at a real time, exact between steps."""
        step = self.step_at(time_s)
        elapsed = time_s - self.times_s[step]
        return ballistic(self.position_m[step], self.speed_mps[step], self.acceleration_mps2[step], elapsed)

    def poses(self, time_s: float) -> tuple[Array, Array]:
        """Centres [M, 2] and headings [M] in radians at a real time."""
        step = self.step_at(time_s)
        position, _ = self.state(time_s)
        centres, headings = np.empty((len(self.kinds), 2)), np.empty(len(self.kinds))
        for m, kind in enumerate(self.kinds):
            shift = Shift(*self.shifts[step, m]) if self.shifts[step, m, :2].any() else None
            path = self.paths[self.path_of[step, m]]
            centres[m], headings[m] = path.axle_pose(position[m], BODIES[kind].wheelbase_m, shift)
        return centres, headings

    def only(self, chosen: NDArray[np.bool_]) -> "Drives":
        """Those of them that are chosen [M]."""
        kinds = tuple(kind for kind, keep in zip(self.kinds, chosen, strict=True) if keep)
        return Drives(
            kinds, self.paths, self.levels_m[chosen], self.kerbs_m[chosen], self.times_s, self.position_m[:, chosen],
            self.speed_mps[:, chosen], self.acceleration_mps2[:, chosen], self.path_of[:, chosen],
            self.shifts[:, chosen], self.present[:, chosen],
        )  # fmt: skip

    def heights(self, time_s: float) -> Array:
        """Heights [M] of the ground under each: walkers step down from the kerb and up again."""
        position, _ = self.state(time_s)
        with np.errstate(invalid="ignore"):
            down = np.clip((position - self.kerbs_m[:, 0]) / KERB_STEP_M, 0, 1)
            up = np.clip((position - self.kerbs_m[:, 1]) / KERB_STEP_M, 0, 1)
        on_road = np.nan_to_num(down - up)
        return self.levels_m - on_road * KERB_HEIGHT_M * (self.levels_m == KERB_HEIGHT_M)

    def speeds(self, time_s: float) -> Array:
        return self.state(time_s)[1]

    def here(self, time_s: float) -> NDArray[np.bool_]:
        """Which of them are there [M]."""
        return self.present[self.step_at(time_s)]


def simulate(network: Network, cars: Sequence[Car], walkers: Sequence[Walker], lights: Mapping[str, Intervals] | None,
             traffic: Traffic, start_s: float, duration_s: float) -> Drives:  # fmt: skip
    """Integrate from `start_s` (zero or before) to a second behind `duration_s`. The actors are used up.

    Raises:
        InputError: two vehicles start inside each other.
    """
    record = _Record(network, cars, walkers)
    _place_grants(cars)
    steps = math.ceil((duration_s + MARGIN_S - start_s) / traffic.step_s - 1e-9) + 1
    kept_from = min(0.0, max(start_s, -MARGIN_S))
    for step in range(steps):
        time_s = start_s + step * traffic.step_s
        lanes = occupancy(cars, network)
        _enter(cars, lanes, time_s, traffic)
        for car in cars:
            if car.parked and time_s >= car.leaves_s:
                _pull_out(car, lanes)
        driving = [car for car in cars if car.present and not car.parked]
        for car in driving:
            car.gap, car.leader_speed = leader(car, lanes)
            if car.gap < 0 and step == 0:
                raise InputError(
                    f"vehicles[{car.number}]: at {time_s:g} s it is {-car.gap:.1f} m inside the vehicle ahead; "
                    "start it farther back or slower."
                )
        grant(driving, list(walkers), network, lights, time_s)
        if step % max(1, round(0.5 / traffic.step_s)) == 0:
            change_lanes(driving, network, lanes, traffic)
        accelerations = _accelerations(driving, network, traffic)
        walking = np.array([walker.advance(traffic.step_s) for walker in walkers])
        if time_s >= kept_from - traffic.step_s:
            record.add(time_s, dict(zip((car.number for car in driving), accelerations, strict=True)), walking)
        _advance(driving, accelerations, traffic.step_s)
        for walker, acceleration in zip(walkers, walking, strict=True):
            walker.move(float(acceleration), traffic.step_s)
        for car in driving:
            if car.stop_m < math.inf and car.speed == 0 and car.stop_m - car.position < 2 * HOLD_M:
                car.parked = True
            if not car.through and car.rear > car.starts[-1] and car.stop_m == math.inf:
                car.present = False
    return record.drives()


def _place_grants(cars: Sequence[Car]) -> None:
    """Who starts inside a junction, or behind one, has had its grant."""
    for car in cars:
        inside = [k for k in car.junctions if car.front > car.starts[k]]
        car.granted = inside[-1] if inside else -1
        car.present = car.enters_s == -math.inf


def _enter(cars: Sequence[Car], lanes: Occupancy, time_s: float, traffic: Traffic) -> None:
    """Let those in whose time has come, at the start of their lane, when there is room; one a lane and step."""
    busy = set()
    for car in cars:
        if car.present or car.enters_s > time_s or car.enters_s == -math.inf or car.route[0] in busy:
            continue
        busy.add(car.route[0])
        car.position = car.half
        gap, speed = leader(car, lanes)
        car.speed = min(car.cruise, speed + 3.0) if math.isfinite(gap) else car.cruise
        if gap > traffic.gap_m + 1.2 * traffic.headway_s * car.speed:
            car.present, car.enters_s = True, -math.inf
            lanes.setdefault(car.route[0], []).append((0.0, car.position, car))


def _pull_out(car: Car, lanes: Occupancy) -> None:
    """Set off from a bay when nobody is near on the lane, or comes up from behind."""
    k = car.lane_at(car.position)
    for _, centre, other in lanes.get(car.route[k], []):
        distance = car.starts[k] + centre - car.position
        if -8.0 - 3.0 * other.speed - other.half - car.half < distance < 12.0:
            return
    shift = car.shift
    start = car.position + 0.5 * BODIES[car.kind].wheelbase_m  # the front axle turns first
    car.shift = Shift(shift.to_m, 0.0, start, PULL_OUT_M)
    car.slow_m = (start, start + PULL_OUT_M)
    car.parked = False


def park_at(car: Car, position: float, left_m: float) -> None:
    """Tell a car to end its way beside its lane."""
    car.stop_m = position
    start = position - 0.5 * BODIES[car.kind].wheelbase_m - PULL_IN_M  # the rear axle arrives last
    car.shift = Shift(0.0, left_m, start, PULL_IN_M)
    car.slow_m = (start, position)


def _accelerations(driving: list[Car], network: Network, traffic: Traffic) -> Array:
    """Of all who drive [M]: the model's, lowered for stop lines, bends and the end of their way."""
    if not driving:
        return np.empty(0)
    speed = np.array([car.speed for car in driving])
    gap = np.array([car.gap for car in driving])
    leader_speed = np.array([car.leader_speed for car in driving])
    cruise = np.array([_desired_speed(car, network) for car in driving])
    acceleration = idm_acceleration(speed, cruise, gap, speed - leader_speed, traffic)
    to_stop = np.array([_distance_to_stop(car) for car in driving])
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = np.where(to_stop > 0, speed**2 / (2 * np.maximum(to_stop, 1e-9)), np.inf)
    # IDM's own approach to a standing obstacle creeps and never quite stops, which no driver does at a red light:
    # brake evenly once it is worth braking, and hold when there.
    even = np.where(needed >= EASY_BRAKING_MPS2, -np.minimum(needed, HARDEST_BRAKING_MPS2), np.inf)
    acceleration = np.minimum(acceleration, np.where(to_stop <= HOLD_M, -HARDEST_BRAKING_MPS2, even))
    # A step must not carry a vehicle over its line either, however long it is.
    acceleration = within_gap(acceleration, speed, np.maximum(to_stop, 0.0), np.zeros_like(speed), traffic.step_s)
    return within_gap(acceleration, speed, gap, leader_speed, traffic.step_s)


def _distance_to_stop(car: Car) -> float:
    """From the front bumper to where it must stand: the stop line of a junction that it may not enter, or its bay."""
    k = car.next_junction()
    to_line = math.inf if k is None else car.starts[k] - STOP_GAP_M - car.front
    return min(to_line, car.stop_m - car.position)


def _desired_speed(car: Car, network: Network) -> float:
    """The speed on a free road, as the bends ahead allow it."""
    speed = car.cruise
    start, end = car.slow_m
    if car.position < end:
        ahead = max(0.0, start - car.front)
        speed = min(speed, math.sqrt(MANOEUVRE_MPS**2 + 2 * BEND_BRAKING_MPS2 * ahead))
    for k in range(car.lane_at(car.rear), len(car.route)):
        ahead = car.starts[k] - car.front
        if ahead > 60:
            break
        limit = network.lanes[car.route[k]].limit_mps
        if limit < speed:
            speed = min(speed, math.sqrt(limit**2 + 2 * BEND_BRAKING_MPS2 * max(0.0, ahead)))
    return max(speed, 0.5)


def _advance(driving: list[Car], accelerations: Array, step_s: float) -> None:
    if not driving:
        return
    before = np.array([car.position for car in driving]), np.array([car.speed for car in driving])
    position, speed = ballistic(*before, accelerations, step_s)
    for m, car in enumerate(driving):
        car.position, car.speed = float(position[m]), float(speed[m])
        if car.beside and car.rear > car.shift.start_m + 0.5 * car.shift.length_m:
            car.beside = None


class _Record:
    """What `Drives` holds, while it grows."""

    def __init__(self, network: Network, cars: Sequence[Car], walkers: Sequence[Walker]) -> None:
        self.network, self.cars, self.walkers = network, cars, walkers
        self.paths: dict[object, int] = {}
        self.table: list[Path] = []
        self.times: list[float] = []
        self.rows: list[list[Array]] = []

    def path(self, key: object, make: Path | None) -> int:
        if key not in self.paths:
            self.paths[key] = len(self.table)
            self.table.append(make if make is not None else self.network.route_path(str(key)))
        return self.paths[key]

    def add(self, time_s: float, accelerations: Mapping[int, float], walking: Array) -> None:
        cars, walkers = self.cars, self.walkers
        shifts = [(c.shift.from_m, c.shift.to_m, c.shift.start_m, c.shift.length_m) for c in cars]
        straight = (STRAIGHT.from_m, STRAIGHT.to_m, STRAIGHT.start_m, STRAIGHT.length_m)
        self.times.append(time_s)
        self.rows.append(
            [
                np.array([*(c.position for c in cars), *(w.position for w in walkers)]),
                np.array([*(c.speed for c in cars), *(w.speed for w in walkers)]),
                np.array([*(accelerations.get(c.number, 0.0) for c in cars), *walking]),
                np.array([*(self.path(c.route_name, None) for c in cars),
                          *(self.path(w.number, w.path) for w in walkers)], dtype=np.int64),
                np.array([*shifts, *[straight] * len(walkers)]).reshape(-1, 4),
                np.array([*(c.present for c in cars), *[True] * len(walkers)], dtype=bool),
            ]
        )  # fmt: skip

    def drives(self) -> Drives:
        columns = [np.array(column) for column in zip(*self.rows, strict=True)]
        kinds = (*(c.kind for c in self.cars), *("pedestrian" for _ in self.walkers))
        levels = [self.network.lanes[c.route[0]].level_m for c in self.cars] + [KERB_HEIGHT_M] * len(self.walkers)
        kerbs = np.array([*[(np.nan, np.nan)] * len(self.cars), *(w.kerbs_m for w in self.walkers)]).reshape(-1, 2)
        return Drives(kinds, tuple(self.table), np.array(levels), kerbs, np.array(self.times), *columns)
