"""Who may enter a junction: lights, people on crossings, who is there already, and who has the right of way.

A junction lane is entered with a grant. A vehicle asks for it where it would have to start braking; until it has it,
it brakes for the stop line. Whoever has a grant keeps every conflicting lane until its rear has left the place where
the two come close, so that two vehicles never meet there, whatever the street looks like. Of two long
ones whose bodies would touch in a bend, one waits as well.
"""

import math
from collections.abc import Mapping

from synth.traffic.actors import Car, Walker
from synth.traffic.network import LONG_M, Network
from synth.traffic.signals import Intervals, green_in_s, is_green

EASY_BRAKING_MPS2 = 2.0  # braking for a stop starts when this would be needed
FIRM_BRAKING_MPS2 = 4.0  # who would need more than this to stop for a red light drives on, as drivers do
LOOK_AHEAD_M = 70.0
SLOWEST_MPS = 3.5  # of a vehicle that crosses, for the time that it will take
MARGIN_S = 1.0


def grant(cars: list[Car], walkers: list[Walker], network: Network, lights: Mapping[str, Intervals] | None,
          time_s: float) -> None:  # fmt: skip
    """Give and take back grants for one step: changes `Car.granted`, `Walker.crossing_now`."""
    holders = _holders(cars)
    on_foot = {walker.wait.crossing for walker in walkers if walker.crossing_now and walker.wait}
    for car in cars:
        _take_back(car, network, lights, time_s, holders)
    asking = []
    for car in cars:
        k = car.next_junction()
        if k is None or time_s < car.hold_s:
            continue
        distance = car.starts[k] - car.front
        if distance < car.speed**2 / (2 * EASY_BRAKING_MPS2) + 0.6 * car.speed + 3.0:
            asking.append((-network.lanes[car.route[k]].rank, distance, car.number, car, k))
    for _, distance, _, car, k in sorted(asking, key=lambda entry: entry[:3]):
        name = car.route[k]
        forced = distance <= 0 or car.speed**2 > 2 * FIRM_BRAKING_MPS2 * distance
        if forced or (
            _green(network, lights, name, time_s)
            and not any(index in on_foot for index, _, _ in network.walked[name])
            and not _blocked(car, k, cars, holders, network, lights, time_s)
        ):
            car.granted = k
            holders.setdefault(name, []).append((car, car.starts[k]))
    for walker in walkers:
        if walker.waiting() and _may_walk(walker, holders, network, lights, time_s):
            walker.crossing_now = True


def _holders(cars: list[Car]) -> dict[str, list[tuple[Car, float]]]:
    """By junction lane, who has it: granted and not yet left, with the arc length of the lane's start on its route."""
    holders: dict[str, list[tuple[Car, float]]] = {}
    for car in cars:
        for k in car.junctions:
            if k <= car.granted and car.rear < car.starts[k + 1]:
                holders.setdefault(car.route[k], []).append((car, car.starts[k]))
    return holders


def _take_back(car: Car, network: Network, lights: Mapping[str, Intervals] | None, time_s: float,
               holders: dict[str, list[tuple[Car, float]]]) -> None:  # fmt: skip
    """When the light turns red before the line, and stopping there is still possible."""
    k = car.granted
    if k < 0 or car.front >= car.starts[k] or _green(network, lights, car.route[k], time_s):
        return
    if car.speed**2 <= 2 * FIRM_BRAKING_MPS2 * (car.starts[k] - car.front):
        earlier = [j for j in car.junctions if j < k]
        car.granted = earlier[-1] if earlier else -1
        holders[car.route[k]] = [entry for entry in holders[car.route[k]] if entry[0] is not car]


def _green(network: Network, lights: Mapping[str, Intervals] | None, name: str, time_s: float) -> bool:
    gate = network.lanes[name].gate
    return lights is None or gate is None or is_green(lights[gate], time_s)


def _blocked(car: Car, k: int, cars: list[Car], holders: dict[str, list[tuple[Car, float]]], network: Network,
             lights: Mapping[str, Intervals] | None, time_s: float) -> bool:  # fmt: skip
    name, start = car.route[k], car.starts[k]
    rank = network.lanes[name].rank
    if 2 * car.half >= LONG_M and _blocked_by_long(car, k, cars, holders, network):
        return True
    if car.leader_speed < 1.0 and car.front + car.gap < car.starts[k + 1] + 2 * car.half + 1.0:
        return True  # nobody stops inside a junction
    for conflict in network.conflicts[name]:
        for other, at in holders.get(conflict.other, ()):
            if other is not car and other.rear < at + conflict.there[1]:
                return True
        if network.lanes[conflict.other].rank <= rank or not _green(network, lights, conflict.other, time_s):
            continue
        clear_s = (start + conflict.here[1] - car.rear) / max(car.speed, SLOWEST_MPS)
        for other in cars:
            j = other.next_junction()
            if other is car or j is None or other.route[j] != conflict.other:
                continue
            away = other.starts[j] + conflict.there[0] - other.front
            if away < LOOK_AHEAD_M and away / max(other.speed, SLOWEST_MPS) < clear_s + MARGIN_S:
                return True
    return False


def _blocked_by_long(car: Car, k: int, cars: list[Car], holders: dict[str, list[tuple[Car, float]]],
                     network: Network) -> bool:  # fmt: skip
    """Whether another long vehicle is or soon will be where both would sweep. Of two lanes of different rank the lower
    one waits, and the higher one never: a ring on which both wait stands still for ever."""
    name = car.route[k]
    rank = network.lanes[name].rank
    for conflict in network.swept[name]:
        above = network.lanes[conflict.other].rank > rank
        if network.lanes[conflict.other].rank < rank:
            continue
        if any(2 * o.half >= LONG_M and o.rear < at + conflict.there[1] for o, at in holders.get(conflict.other, ())):
            return True
        clear_s = (car.starts[k] + conflict.here[1] - car.rear) / max(car.speed, SLOWEST_MPS)
        for other in cars:
            if not above or 2 * other.half < LONG_M or conflict.other not in other.route:
                continue
            away = other.starts[other.route.index(conflict.other)] + conflict.there[0] - other.front
            if 0 < away < LOOK_AHEAD_M and away / max(other.speed, SLOWEST_MPS) < clear_s + MARGIN_S:
                return True
    return False


def _may_walk(walker: Walker, holders: dict[str, list[tuple[Car, float]]], network: Network,
              lights: Mapping[str, Intervals] | None, time_s: float) -> bool:  # fmt: skip
    assert walker.wait is not None
    index = walker.wait.crossing
    gate = network.crossings[index].gate
    if lights is not None and gate is not None:
        needed_s = network.crossings[index].length_m / walker.cruise + 1.0
        green_s = green_in_s(lights[gate], time_s)
        if green_s < (needed_s if math.isfinite(green_s) else 0.0):
            return False
    for name, held in holders.items():
        for crossing, _, end in network.walked[name]:
            if crossing == index and any(car.rear < at + end for car, at in held):
                return False
    return True
