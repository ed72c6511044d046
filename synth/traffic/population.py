"""Who is in a scene before anything moves: placed by hand, flowing in, parked, leaving, arriving, on foot."""

import math
from dataclasses import dataclass

import numpy as np

from synth.errors import InputError
from synth.seeds import generator
from synth.traffic.actors import Car, Wait, Walker
from synth.traffic.fleet import BODIES, Kind, Paint, paints
from synth.traffic.network import RUN_UP_M, Network
from synth.traffic.paths import Path, Shift, rounded
from synth.traffic.settings import Flow, Parking, Pedestrians, Traffic, Vehicle
from synth.traffic.simulation import STOP_GAP_M, park_at

PARKED_KINDS: tuple[tuple[Kind, float], ...] = (("hatchback", 0.40), ("saloon", 0.28), ("suv", 0.22), ("van", 0.10))
CAR_KINDS: tuple[tuple[Kind, float], ...] = (("hatchback", 0.38), ("saloon", 0.34), ("suv", 0.28))
CRUISE_MPS = 9.0  # of those who leave and arrive
MANOEUVRE_S = 2.0  # longer than at that speed, to pull in
WAIT_M = (0.4, 1.5)  # from the kerb to where people wait


@dataclass(frozen=True)
class Parked:
    """A vehicle that stands through the clip."""

    kind: Kind
    centre: tuple[float, float]
    heading: float  # radians
    level_m: float = 0.0


@dataclass(frozen=True)
class Amends:
    """Those of whom the draw would let two touch: numbers of walkers who turn away from the junction instead of
    walking into it, and of walkers, cars and parked vehicles that are left out."""

    turned: frozenset[int] = frozenset()
    walkers: frozenset[int] = frozenset()
    cars: frozenset[int] = frozenset()
    parked: frozenset[int] = frozenset()

    @property
    def left_out(self) -> int:
        return len(self.walkers) + len(self.cars) + len(self.parked)


NO_AMENDS = Amends()


@dataclass(frozen=True)
class Population:
    """All road users. `where` and `colours` name and paint the cars, in their order."""

    cars: tuple[Car, ...]
    where: tuple[str, ...]
    colours: tuple[Paint | None, ...]
    walkers: tuple[Walker, ...]
    parked: tuple[Parked, ...]


def populate(network: Network, vehicles: tuple[Vehicle, ...], flows: tuple[Flow, ...], traffic: Traffic,
             parking: Parking, people: Pedestrians, seed: int, duration_s: float,
             amends: Amends = NO_AMENDS) -> Population:  # fmt: skip
    """Draw everybody from the seed; each group from a stream of its own, so that none changes another. The draws do not
    depend on the amends: nobody but those whom they name changes.

    Raises:
        InputError: a route that the street does not have, or more parking manoeuvres than bays allow.
    """
    cars: list[Car] = []
    where: list[str] = []
    colours: list[Paint | None] = []
    for index, vehicle in enumerate(vehicles):
        cars.append(_placed(network, vehicle, index))
        where.append(vehicle.route)
        colours.append(vehicle.colour)
    taken, leaving, arriving = _bays(network, traffic, parking, seed)
    for kind, index in leaving:
        cars.append(_leaver(network, index, kind, len(cars), seed, duration_s))
        where.append("leaving")
    for kind, index in arriving:
        cars.append(_arrival(network, index, kind, len(cars), seed, duration_s))
        where.append("arriving")
    for flow in flows:
        for car in _flow(network, flow, traffic, len(cars), seed, duration_s):
            cars.append(car)
            where.append(car.route_name.split("/")[0])
    colours += [None] * (len(cars) - len(colours))
    early_s = traffic.warm_up_s if flows or parking.arriving else 0.0
    walkers = _walkers(network, people, seed, duration_s, early_s, amends.turned)
    for car in cars:
        if car.number in amends.cars:
            car.enters_s = math.inf
    return Population(
        tuple(cars), tuple(where), tuple(colours),
        tuple(walker for walker in walkers if walker.number not in amends.walkers),
        tuple(parked for place, parked in enumerate(taken) if place not in amends.parked),
    )  # fmt: skip


def draw_paint(kind: str, rng: np.random.Generator) -> Paint:
    """A paint as often as it is seen."""
    choices = paints(kind)
    weights = np.array([weight for _, weight in choices])
    return choices[rng.choice(len(choices), p=weights / weights.sum())][0]


def _placed(network: Network, vehicle: Vehicle, index: int) -> Car:
    movements = sorted({name.split("/")[0] for name in network.routes})
    if vehicle.route not in network.routes and vehicle.route not in movements:
        raise InputError(f"vehicles[{index}].route: {vehicle.route!r} must be one of {', '.join(movements)}.")
    half = 0.5 * BODIES[vehicle.kind].length_m
    car = Car(index, vehicle.kind, half, vehicle.cruise_mps, network, network.full(vehicle.route))
    line = network.stop_line_m(vehicle.route)
    first, last = math.ceil(-RUN_UP_M - line), math.floor(car.starts[-1] + RUN_UP_M - line)
    if not first <= vehicle.position_m <= last:
        raise InputError(
            f"vehicles[{index}].position_m: {vehicle.position_m:g} is off the road of {vehicle.route}; it must be a "
            f"number from {first} to {last}, or street.arm_m longer."
        )
    car.position = line + vehicle.position_m - half
    car.speed, car.through = vehicle.speed_mps, True
    return car


def _flow(network: Network, flow: Flow, traffic: Traffic, first: int, seed: int, duration_s: float) -> list[Car]:
    cars: list[Car] = []
    for lane, routes in network.entries.items():
        arm, cycle = lane.split("-")[0], lane.endswith("/cycle")
        rate = flow.cyclists_per_hour if cycle else flow.per_hour
        if flow.arm not in ("all", arm) or rate <= 0:
            continue
        rng = generator(seed, f"flow {flow.arm} {lane}")
        time = -traffic.warm_up_s + float(rng.exponential(3600 / rate))
        while time < duration_s + 1.0:
            kind = "cyclist" if cycle else _kind(flow, rng)
            straight = [r for r in routes if _is_straight(r)]
            turns = [r for r in routes if r not in straight]
            turn = rng.random() < flow.turning
            if kind in ("bus", "truck"):  # too long for the corners of these streets
                turn, kind = False, kind if straight else "van"
            choices = (turns or straight) if turn else (straight or turns)
            route = choices[int(rng.integers(len(choices)))]
            cruise = (0.5 if cycle else 1.0) * flow.cruise_mps * float(np.clip(rng.normal(1.0, 0.1), 0.75, 1.25))
            car = Car(first + len(cars), kind, 0.5 * BODIES[kind].length_m, cruise, network, route)
            car.enters_s = time
            cars.append(car)
            time += 1.2 + float(rng.exponential(max(3600 / rate - 1.2, 0.1)))
    return cars


def _kind(flow: Flow, rng: np.random.Generator) -> Kind:
    draw = rng.random()
    large: tuple[tuple[Kind, float], ...] = (("van", flow.vans), ("bus", flow.buses), ("truck", flow.trucks))
    for kind, share in large:
        if draw < share:
            return kind
        draw -= share
    return _choose(CAR_KINDS, rng)


def _choose(kinds: tuple[tuple[Kind, float], ...], rng: np.random.Generator) -> Kind:
    return kinds[rng.choice(len(kinds), p=[weight for _, weight in kinds])][0]


def _is_straight(route: str) -> bool:
    return route.split("/")[0] in ("east-west", "west-east", "north-south", "south-north")


Pairs = list[tuple[Kind, int]]  # a kind and the index of its bay


def _bays(network: Network, traffic: Traffic, parking: Parking, seed: int) -> tuple[tuple[Parked, ...], Pairs, Pairs]:
    """Fill each bay with the given probability; then make room for those who leave and arrive: from a kerb a vehicle
    leaves forwards, so that the bays ahead of it must be free, and arrives over those behind its own."""
    rng = generator(seed, "parking")
    drawn = []
    for _ in network.bays:
        drawn.append((rng.random() < traffic.parked_share, _choose(PARKED_KINDS, rng), rng.uniform(-0.3, 0.3),
                      rng.normal(0, 0.015)))  # fmt: skip
    free = [not parked for parked, *_ in drawn]
    order = generator(seed, "parking manoeuvres").permutation(len(network.bays))
    near = [int(i) for i in order if math.hypot(*network.bays[int(i)].pose[:2]) < parking.reach_m]
    used: set[int] = set()
    found: dict[str, list[int]] = {"leaving": [], "arriving": []}
    for what, wanted in (("leaving", parking.leaving), ("arriving", parking.arriving)):
        for i in near:
            if len(found[what]) == wanted:
                break
            beside = _room(network, i, what)
            if beside is None or used & {i, *beside}:
                continue
            used |= {i, *beside}
            found[what].append(i)
            for j in (i, *beside):
                free[j] = True
        if len(found[what]) < wanted:
            raise InputError(f"parking.{what}: there is room for {len(found[what])} only; ask for no more, or enlarge "
                             "parking.reach_m.")  # fmt: skip
    parked = []
    for bay, (_, kind, shift, twist), empty in zip(network.bays, drawn, free, strict=True):
        if empty:
            continue
        x, y, heading = bay.pose
        if not bay.lane:  # end to end with another: no room for the longest, and little for the careless
            kind, shift = ("suv" if kind == "van" else kind), 0.3 * shift
        # Against the kerb: the bay's middle is that of the widest.
        aside = 0.5 * (BODIES["van"].width_m - BODIES[kind].width_m) if bay.lane else 0.0
        cos, sin = math.cos(heading), math.sin(heading)
        centre = (x + shift * cos + aside * sin, y + shift * sin - aside * cos)
        level = network.lanes[bay.lane].level_m if bay.lane else 0.0
        parked.append(Parked(kind, centre, heading + twist, level))
    pairs = [[(drawn[i][1] if drawn[i][1] != "van" else "suv", i) for i in found[what]] for what in found]
    return tuple(parked), pairs[0], pairs[1]


def _room(network: Network, index: int, what: str) -> tuple[int, ...] | None:
    """The bays that must be free besides the one that is left or taken; None where it cannot be."""
    bay = network.bays[index]
    if not bay.lane:
        return () if _lot_routes(network, index, what) else None
    same = sorted((b.s_m, i) for i, b in enumerate(network.bays) if b.lane == bay.lane)
    at = next(n for n, (_, i) in enumerate(same) if i == index)
    if not 1 < at < len(same) - 2:
        return None
    ahead = 1 if what == "leaving" else -1
    return tuple(same[at + ahead * n][1] for n in (1, 2))


def _lot_routes(network: Network, index: int, what: str) -> list[str]:
    """Routes from (`what` is "leaving") or to ("arriving") a bay of a car park."""
    end = 0 if what == "leaving" else 1
    return [name for name in network.routes if name.split("/")[0].split("-")[end] == f"lot{index}"]


def _on_bay(network: Network, index: int, kind: str, number: int, rng: np.random.Generator) -> tuple[Car, float]:
    """A car on a route past a kerbside bay, and the bay's arc length on that route."""
    bay = network.bays[index]
    routes = [name for name, lanes in network.routes.items() if bay.lane in lanes]
    choices = [name for name in routes if _is_straight(name)] or routes
    route = choices[int(rng.integers(len(choices)))]
    car = Car(number, kind, 0.5 * BODIES[kind].length_m, CRUISE_MPS, network, route)
    return car, car.starts[car.route.index(bay.lane)] + bay.s_m


def _leaver(network: Network, index: int, kind: str, number: int, seed: int, duration_s: float) -> Car:
    rng = generator(seed, f"leaving {number}")
    out = _lot_routes(network, index, "leaving")
    leaves_s = float(rng.uniform(0.05, 0.5)) * duration_s
    if out:
        car = Car(number, kind, 0.5 * BODIES[kind].length_m, CRUISE_MPS, network, out[int(rng.integers(len(out)))])
        car.position, car.hold_s = car.starts[1] - STOP_GAP_M - car.half, leaves_s
        return car
    car, at = _on_bay(network, index, kind, number, rng)
    left = network.bays[index].left_m
    car.position, car.shift = at, Shift(left, left, 0.0, 1.0)
    car.parked, car.leaves_s = True, leaves_s
    return car


def _arrival(network: Network, index: int, kind: str, number: int, seed: int, duration_s: float) -> Car:
    """Comes in so early that it arrives during the clip."""
    rng = generator(seed, f"arriving {number}")
    into = _lot_routes(network, index, "arriving")
    if into:
        car = Car(number, kind, 0.5 * BODIES[kind].length_m, CRUISE_MPS, network, into[int(rng.integers(len(into)))])
        car.stop_m = at = car.starts[-1] - 0.5 - car.half
    else:
        car, at = _on_bay(network, index, kind, number, rng)
        park_at(car, at, network.bays[index].left_m)
    lanes = [(network.lanes[name], car.starts[k], car.starts[k + 1]) for k, name in enumerate(car.route)]
    needed_s = sum(max(0.0, min(end, at) - start) / min(0.9 * lane.limit_mps, CRUISE_MPS) for lane, start, end in lanes)
    car.enters_s = float(rng.uniform(0.5, 1.0)) * duration_s - needed_s - MANOEUVRE_S
    return car


def _walkers(network: Network, people: Pedestrians, seed: int, duration_s: float, early_s: float,
             turned: frozenset[int]) -> tuple[Walker, ...]:  # fmt: skip
    rng = generator(seed, "pedestrians")
    walkers: list[Walker] = []
    for number in range(people.crossing if network.crossings else 0):
        index = int(rng.integers(len(network.crossings)))
        crossing = network.crossings[index]
        a, b = (crossing.start, crossing.end) if rng.random() < 0.5 else (crossing.end, crossing.start)
        ux, uy = (b[0] - a[0]) / crossing.length_m, (b[1] - a[1]) / crossing.length_m
        side = rng.choice([-1.0, 1.0])
        aside = float(rng.uniform(-0.4, 0.4)) * crossing.width_m
        away = float(rng.uniform(1.2, 2.6))
        before, after = float(rng.uniform(1.0, 14.0)), float(rng.uniform(12.0, 30.0))

        def at(along: float, across: float, origin: tuple[float, float] = a, u: tuple[float, float] = (ux, uy)
               ) -> tuple[float, float]:  # fmt: skip
            return origin[0] + along * u[0] - across * u[1], origin[1] + along * u[1] + across * u[0]

        far = crossing.length_m + away
        comes, goes = side, -float(rng.choice([-1, 1]))
        if number in turned:  # the pavement goes on outwards for certain; inwards another street may cross it
            comes = goes = 1.0 if math.hypot(*at(0.0, 1.0)) > math.hypot(*at(0.0, -1.0)) else -1.0
        path = rounded([at(-away, aside + comes * before), at(-away, aside), at(far, aside),
                        at(far, aside + goes * after)], 0.5)  # fmt: skip
        # A rounded corner of half a metre is shorter than a sharp one.
        kerb = before + away - 0.5 * (2 - 0.5 * math.pi)
        cruise = people.speed_mps * float(np.clip(rng.normal(1, 0.12), 0.7, 1.4))
        # Some are at the kerb when the clip starts, others come later.
        start = kerb - WAIT_M[1] - 0.1 - float(rng.uniform(0.0, 0.6)) * duration_s * cruise - early_s * cruise
        wait = Wait(kerb - float(rng.uniform(*WAIT_M)), kerb, kerb + crossing.length_m, index)
        walkers.append(Walker(number, path, start, cruise, wait))
    for number in range(people.strolling if network.walks else 0):
        path = network.walks[int(rng.integers(len(network.walks)))]
        if rng.random() < 0.5:
            path = Path(tuple(_reversed(path)))
        path = path.inset(float(rng.uniform(-0.5, 0.5)))
        near = min(path.length_m, 60.0)
        begin = float(rng.uniform(0.0, near)) if rng.random() < 0.5 else float(rng.uniform(0, path.length_m))
        cruise = people.speed_mps * float(np.clip(rng.normal(1, 0.15), 0.6, 1.5))
        walkers.append(Walker(people.crossing + number, path, begin - early_s * cruise, cruise, None))
    return tuple(walkers)


def _reversed(path: Path) -> list:
    pieces = []
    for piece in reversed(path.pieces):
        pieces.append(type(piece)(piece.end, piece.end_heading + math.pi, -piece.curvature, piece.length_m))
    return pieces
