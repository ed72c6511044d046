"""Who is on which lane, and who drives ahead of whom."""

import math
from collections.abc import Sequence

from synth.traffic.actors import Car
from synth.traffic.network import Network

Occupancy = dict[str, list[tuple[float, float, Car]]]  # by lane: arc lengths of the rear and of the centre on it, who

HORIZON_M = 120.0


def occupancy(cars: Sequence[Car], network: Network) -> Occupancy:
    """All vehicles on all lanes that they touch. A vehicle that turns off counts on the lanes that it parts from as
    long as it is near them, one that changes lanes on both."""
    lanes: Occupancy = {}
    for car in cars:
        if not car.present or car.parked:
            continue
        for k in range(car.lane_at(car.rear), car.lane_at(car.front) + 1):
            name, start = car.route[k], car.starts[k]
            entry = (car.rear - start, car.position - start, car)
            lanes.setdefault(name, []).append(entry)
            for other, until in network.partings.get(name, ()):
                if entry[0] < until:
                    lanes.setdefault(other, []).append(entry)
            if car.beside in (network.lanes[name].left, network.lanes[name].right) and car.beside:
                lanes.setdefault(car.beside, []).append(entry)
    return lanes


def leader(car: Car, lanes: Occupancy) -> tuple[float, float]:
    """Gap to the rear bumper of the next vehicle on its route, and that vehicle's speed; (inf, 0) on a free road."""
    gap, speed = math.inf, 0.0
    for k in range(car.lane_at(car.rear), len(car.route)):
        start = car.starts[k]
        if start - car.front > HORIZON_M:
            break
        for rear, centre, other in lanes.get(car.route[k], ()):
            if other is car:
                continue
            ahead = start + centre - car.position
            if (ahead > 0 or (ahead == 0 and other.number < car.number)) and start + rear - car.front < gap:
                gap, speed = start + rear - car.front, other.speed
        if math.isfinite(gap):
            break  # whoever is on a later lane is farther
    if car.beside and car.front < car.shift.start_m + 0.6 * car.shift.length_m:
        start = car.starts[car.lane_at(car.position)]
        for rear, _, other in lanes.get(car.beside, ()):  # not yet out of the way of who was ahead
            if other is not car and 0 <= start + rear - car.front < gap:
                gap, speed = start + rear - car.front, other.speed
    return gap, speed
