"""The arms of a junction, and the lanes that connect them: what most streets are made of."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from synth.traffic.network import Bay, Crossing, Group, Lane, Network
from synth.traffic.paths import Path, Piece, Point, line, rounded

DIRECTIONS = {"east": 0, "north": 90, "west": 180, "south": 270}
CROSSING_WIDTH_M = 2.6
CROSSING_SETBACK_M = 0.6  # from the end of the kerb's curve to the zebra crossing
STOP_SETBACK_M = 1.0  # from the zebra crossing to the stop line
SIDE_ACCELERATION_MPS2 = 2.6  # what drivers accept in bends: it limits their speed there
BAY_M = 6.0
CLEAR_OF_STOP_LINE_M = 5.0
CLEAR_OF_KERB_M = 0.2
WIDEST_PARKED_M = 2.0


@dataclass(frozen=True)
class Arm:
    """One street that leaves the junction at the origin, the same in both directions; metres.

    From its middle outwards: half of the median, `lanes` lanes, a cycle lane, a parking strip, the kerb. `along` is
    measured from the origin, `across` to the left of the outward direction.
    """

    name: str
    length_m: float
    lane_width_m: float
    lanes: int = 1
    median_m: float = 0.0
    cycle_m: float = 0.0
    parking_m: float = 0.0
    level_m: float = 0.0

    @property
    def angle(self) -> float:
        return math.radians(DIRECTIONS[self.name])

    @property
    def group(self) -> Group:
        return "east_west" if self.name in ("east", "west") else "north_south"

    @property
    def carriageway_m(self) -> float:
        """Half of what is driven on, without the parking strip."""
        return 0.5 * self.median_m + self.lanes * self.lane_width_m + self.cycle_m

    @property
    def half_width_m(self) -> float:
        """From the middle to the kerb."""
        return self.carriageway_m + self.parking_m

    def offset(self, lane: int) -> float:
        """From the middle to the centre of a lane; lane 0 is the rightmost, lane -1 the cycle lane."""
        if lane < 0:
            return self.carriageway_m - 0.5 * self.cycle_m
        return 0.5 * self.median_m + (self.lanes - 0.5 - lane) * self.lane_width_m

    def place(self, along: float, across: float) -> Point:
        dx, dy = round(math.cos(self.angle)), round(math.sin(self.angle))
        return dx * along - dy * across, dy * along + dx * across

    def inbound(self, lane: int, along: float) -> Point:
        return self.place(along, self.offset(lane))

    def outbound(self, lane: int, along: float) -> Point:
        return self.place(along, -self.offset(lane))


@dataclass(frozen=True)
class Junction:
    """Arms, and for each the distance of the stop line and of the end of the kerb's curve from the origin."""

    arms: Mapping[str, Arm]
    stop_m: Mapping[str, float]
    edge_m: Mapping[str, float]
    corner_m: float
    major: frozenset[str] = frozenset()  # arms that have the right of way; none: all are equal
    crossings: bool = True
    signals: bool = False


def junction(arms: Sequence[Arm], corner_m: float, *, major: Sequence[str] = (), crossings: bool = True,
             signals: bool = False) -> Junction:  # fmt: skip
    """Where stop lines and kerbs lie: each arm must be clear of the widest arm across it."""
    edges = {}
    for arm in arms:
        across = [other.half_width_m for other in arms if other.group != arm.group]
        edges[arm.name] = (max(across) if across else 0.0) + corner_m
    setback = CROSSING_SETBACK_M + CROSSING_WIDTH_M if crossings else 0.0
    stops = {name: edge + setback + STOP_SETBACK_M for name, edge in edges.items()}
    return Junction({arm.name: arm for arm in arms}, stops, edges, corner_m, frozenset(major), crossings, signals)


def network(shape: Junction) -> Network:
    """Approaches, all movements through the junction, exits, crossings and bays."""
    lanes: dict[str, Lane] = {}
    routes: dict[str, tuple[str, ...]] = {}
    for arm in shape.arms.values():
        lanes |= approach_lanes(arm, shape.stop_m[arm.name])
    for source, target in itertools.permutations(shape.arms.values(), 2):
        for lane_in, lane_out in _movements(source, target):
            name = f"{source.name}-{target.name}/{'cycle' if lane_in < 0 else lane_in}"
            path = _connector(shape, source, target, lane_in, lane_out)
            gate = source.group if shape.signals else None
            lanes[name] = Lane(path, True, _rank(shape, source, target), gate, bend_limit(path),
                               level_m=source.level_m)  # fmt: skip
            routes[name] = (lane_name(source, lane_in, "in"), name, lane_name(target, lane_out, "out"))
    bays = [bay for arm in shape.arms.values() for bay in arm_bays(arm, shape.stop_m[arm.name])]
    walks = [path for arm in shape.arms.values() for path in arm_walks(arm, shape.stop_m[arm.name])]
    return Network(lanes, routes, _crossings(shape), tuple(bays), tuple(walks), entries(routes))


def lane_name(arm: Arm, lane: int, way: str) -> str:
    return f"{arm.name}-{way}/{'cycle' if lane < 0 else lane}"


def entries(routes: Mapping[str, tuple[str, ...]]) -> dict[str, tuple[str, ...]]:
    """Routes by the lane that they start on."""
    first: dict[str, list[str]] = {}
    for route, names in routes.items():
        first.setdefault(names[0], []).append(route)
    return {lane: tuple(found) for lane, found in first.items()}


def approach_lanes(arm: Arm, stop: float) -> dict[str, Lane]:
    """The lanes of an arm outside the junction, in and out."""
    lanes = {}
    numbers = [*range(arm.lanes), *([-1] if arm.cycle_m else [])]
    for lane, way in itertools.product(numbers, ("in", "out")):
        ends = (arm.length_m, stop) if way == "in" else (stop, arm.length_m)
        place = arm.inbound if way == "in" else arm.outbound
        path = Path((line(place(lane, ends[0]), place(lane, ends[1])),))
        left = lane_name(arm, lane + 1, way) if 0 <= lane < arm.lanes - 1 else None
        right = lane_name(arm, lane - 1, way) if lane > 0 else None
        lanes[lane_name(arm, lane, way)] = Lane(path, left=left, right=right, level_m=arm.level_m)
    return lanes


def bend_limit(path: Path) -> float:
    """The speed at which the tightest bend asks for the sideways acceleration that drivers accept."""
    tightest = max((abs(piece.curvature) for piece in path.pieces), default=0.0)
    return math.sqrt(SIDE_ACCELERATION_MPS2 / tightest) if tightest > 0 else math.inf


def turning(source: Arm, target: Arm) -> int:
    """1 for a left turn, -1 for a right turn, 0 straight on."""
    return round(math.sin(target.angle - (source.angle + math.pi)))


def _movements(source: Arm, target: Arm) -> list[tuple[int, int]]:
    """Pairs of lanes (in, out) that a movement connects."""
    turn = turning(source, target)
    if turn < 0:
        return [(0, 0)]
    if turn > 0:
        return [(source.lanes - 1, target.lanes - 1)]
    pairs = [(lane, lane) for lane in range(min(source.lanes, target.lanes))]
    return pairs + ([(-1, -1)] if source.cycle_m and target.cycle_m else [])


def _connector(shape: Junction, source: Arm, target: Arm, lane_in: int, lane_out: int) -> Path:
    start = source.inbound(lane_in, shape.stop_m[source.name])
    end = target.outbound(lane_out, shape.stop_m[target.name])
    turn = turning(source, target)
    if turn == 0:
        return Path((line(start, end),))
    dx, dy = math.cos(source.angle), math.sin(source.angle)
    corner = _meet(start, (dx, dy), end, (math.cos(target.angle), math.sin(target.angle)))
    if turn < 0:  # about the same centre as the kerb
        radius = shape.corner_m + min(
            source.half_width_m - source.offset(lane_in), target.half_width_m - target.offset(lane_out)
        )
    else:
        radius = max(shape.edge_m[source.name], shape.edge_m[target.name])
    return rounded([start, corner, end], radius)


def _meet(p: Point, u: tuple[float, float], q: Point, v: tuple[float, float]) -> Point:
    """Where the line through p along u meets the one through q along v."""
    cross = u[0] * v[1] - u[1] * v[0]
    share = ((q[0] - p[0]) * v[1] - (q[1] - p[1]) * v[0]) / cross
    return p[0] + share * u[0], p[1] + share * u[1]


def _rank(shape: Junction, source: Arm, target: Arm) -> int:
    """Straight on before right before left; the major street before the minor one."""
    order = {0: 3, -1: 2, 1: 1}[turning(source, target)]
    return order + (4 if source.name in shape.major else 0)


def _crossings(shape: Junction) -> tuple[Crossing, ...]:
    if not shape.crossings:
        return ()
    found = []
    for arm in shape.arms.values():
        along = shape.edge_m[arm.name] + CROSSING_SETBACK_M + 0.5 * CROSSING_WIDTH_M
        half = arm.half_width_m
        found.append(Crossing(arm.place(along, -half), arm.place(along, half), CROSSING_WIDTH_M,
                              arm.group if shape.signals else None, arm.level_m))  # fmt: skip
    return tuple(found)


def arm_bays(arm: Arm, stop: float) -> list[Bay]:
    """Bays along both kerbs, away from the stop line, on the right of the traffic beside them."""
    if arm.parking_m <= 0:
        return []
    bays = []
    across = arm.half_width_m - CLEAR_OF_KERB_M - 0.5 * WIDEST_PARKED_M
    left = -(across - arm.offset(0))
    for way in ("in", "out"):
        for along in np.arange(stop + CLEAR_OF_STOP_LINE_M + 0.5 * BAY_M, arm.length_m - BAY_M, BAY_M):
            x, y = arm.place(float(along), across if way == "in" else -across)
            heading = arm.angle + (math.pi if way == "in" else 0.0)
            s = arm.length_m - float(along) if way == "in" else float(along) - stop
            bays.append(Bay(lane_name(arm, 0, way), s, left, (x, y, heading)))
    return bays


def arm_walks(arm: Arm, stop: float, inside_m: float = 2.1) -> list[Path]:
    """Paths along both pavements of an arm, outwards."""
    across = arm.half_width_m + inside_m
    return [Path((line(arm.place(stop, side * across), arm.place(arm.length_m, side * across)),)) for side in (-1, 1)]


def arc(centre: Point, radius: float, start: float, sweep: float) -> Piece:
    """A circular arc by its centre, from the angle `start` over `sweep` (radians, positive to the left)."""
    heading = start + math.copysign(0.5 * math.pi, sweep)
    first = (centre[0] + radius * math.cos(start), centre[1] + radius * math.sin(start))
    return Piece(first, heading, math.copysign(1 / radius, sweep), radius * abs(sweep))
