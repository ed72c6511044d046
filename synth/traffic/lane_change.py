"""Changing lanes: the MOBIL criterion, and a path that is smooth in place.

Kesting, Treiber, Helbing, "General lane-changing model MOBIL for car-following models", Transportation Research
Record 1999 (2007): change when the own acceleration gains more than a threshold plus what the new follower loses,
weighed by politeness, and never when the new follower would have to brake hard.
"""

import math

import numpy as np

from synth.traffic.actors import Car
from synth.traffic.following import idm_acceleration
from synth.traffic.network import Network
from synth.traffic.occupancy import Occupancy
from synth.traffic.paths import Shift
from synth.traffic.settings import Traffic

POLITENESS = 0.2
THRESHOLD_MPS2 = 0.3
SAFE_BRAKING_MPS2 = 2.0
LEAST_MPS = 4.0  # in a queue nobody changes
CLEAR_OF_JUNCTION_M = 15.0
SECONDS = 3.0  # a change takes about this long
SHORTEST_M = 22.0
STAY = ("bus", "truck", "cyclist")


def change_lanes(cars: list[Car], network: Network, lanes: Occupancy, traffic: Traffic) -> None:
    """Let every vehicle to which it is worth it begin a change; at most one a lane and step, against swaps."""
    taken: set[str] = set()
    for car in cars:
        k = car.lane_at(car.front)
        lane = network.lanes[car.route[k]]
        length = max(SHORTEST_M, SECONDS * car.speed)
        busy = car.position < car.shift.start_m + car.shift.length_m and car.shift.from_m != car.shift.to_m
        if lane.junction or busy or car.speed < LEAST_MPS or car.lane_at(car.rear) != k or car.stop_m < math.inf:
            continue
        if k > 0 and car.rear < car.starts[k] + CLEAR_OF_JUNCTION_M:
            continue  # who turns in does not see it
        if car.gap < 0.6 * length:
            continue  # too late to get past who is ahead
        if car.front + length > car.starts[k + 1] or car.kind in STAY:
            continue
        options = []
        for target in (lane.left, lane.right):
            route = _beside(car, network, k, target)
            if route is None or target is None or target in taken:
                continue
            gain = _gain(car, lanes, target, car.starts[k], traffic)
            if gain > THRESHOLD_MPS2:
                options.append((gain, target, route))
        if options:
            _, target, route = max(options)
            taken |= {target, car.route[k]}
            _move(car, network, k, route, length)


def _beside(car: Car, network: Network, k: int, target: str | None) -> str | None:
    """The route between the same places on the lane beside."""
    if target is None:
        return None
    movement = car.route_name.split("/")[0]
    return next((name for name, route in network.routes.items()
                 if name.split("/")[0] == movement and len(route) > k and route[k] == target), None)  # fmt: skip


def _gain(car: Car, lanes: Occupancy, target: str, start: float, traffic: Traffic) -> float:
    """What the change is worth in m/s^2; minus infinity when it is not safe."""
    ahead, behind = math.inf, math.inf
    ahead_speed, follower = 0.0, None
    for rear, centre, other in lanes.get(target, ()):
        if start + centre >= car.position:
            if start + rear - car.front < ahead:
                ahead, ahead_speed = start + rear - car.front, other.speed
        elif car.rear - (start + rear + 2 * other.half) < behind:
            behind, follower = car.rear - (start + rear + 2 * other.half), other
    if ahead < 2.0 + 0.3 * car.speed or behind < 2.0:
        return -math.inf
    new = _idm(car.speed, car.cruise, ahead, ahead_speed, traffic)
    old = _idm(car.speed, car.cruise, car.gap, car.leader_speed, traffic)
    loss = 0.0
    if follower is not None:
        after = _idm(follower.speed, follower.cruise, behind, car.speed, traffic)
        if after < -SAFE_BRAKING_MPS2:
            return -math.inf
        loss = _idm(follower.speed, follower.cruise, follower.gap, follower.leader_speed, traffic) - after
    return new - old - POLITENESS * loss


def _idm(speed: float, cruise: float, gap: float, leader_speed: float, traffic: Traffic) -> float:
    closing = np.array(speed - leader_speed)
    return float(idm_acceleration(np.array(speed), np.array(cruise), np.array(gap), closing, traffic))


def _move(car: Car, network: Network, k: int, route: str, length: float) -> None:
    """Onto the other route, from beside it. The paths run side by side up to here, but may differ in length before."""
    old = network.lanes[car.route[k]]
    to_left = old.left == network.routes[route][k]
    along = car.position - car.starts[k]
    here, there = (network.lanes[name].path.points(np.array(0.0)) for name in (car.route[k], network.routes[route][k]))
    width = float(np.hypot(*(here - there)))
    leaving = car.route[k]
    car.take(network, route)
    car.position = car.starts[k] + along
    # The front axle is where the shift begins: at this instant nothing moves.
    axle = car.position + 0.4 * 2 * car.half
    car.shift = Shift(-width if to_left else width, 0.0, axle, length)
    car.beside = leaving
