"""Lanes, how they join into routes, where they cross one another, and where one may park or walk.

Traffic keeps to the right. A lane marked `junction` may be entered only with a grant (see `right_of_way`); where two
such lanes come too close to each other is found from their geometry, so that a new street needs no table of conflicts.
"""

import itertools
import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from synth.traffic.fleet import BODIES
from synth.traffic.paths import Path, Point, joints

__all__ = ["Bay", "Conflict", "Crossing", "Lane", "Network", "joints"]

Array = NDArray[np.float64]
Group = str  # of signal lights: "east_west" or "north_south"

KERB_HEIGHT_M = 0.12
RUN_UP_M = 60.0  # roads go on behind the ends of their lanes; the deck of an overpass so far and no farther
SAMPLE_M = 0.4
CLEAR_M = 2.5  # centre lines nearer than this: two vehicles of usual width would touch, or nearly
LONGEST = BODIES["bus"]
LONG_M = 8.0  # from this length on, a body sweeps over more than its width
SWEPT_MARGIN_M, SWEPT_SAMPLE_M = 0.4, 0.8
WALKER_M = 0.6  # from the edge of a crossing to where a vehicle's bumper may be


@dataclass(frozen=True)
class Lane:
    """One lane. `rank` orders who goes first into a junction; `gate` names the lights that guard its start."""

    path: Path
    junction: bool = False
    rank: int = 0
    gate: Group | None = None
    limit_mps: float = math.inf
    left: str | None = None  # the lane beside it that starts and ends beside it, to change to
    right: str | None = None
    level_m: float = 0.0  # height of its surface


@dataclass(frozen=True)
class Crossing:
    """A zebra crossing from kerb to kerb. People walk while the lights `gate` are red; without lights at any time."""

    start: Point
    end: Point
    width_m: float
    gate: Group | None = None
    level_m: float = 0.0

    @property
    def length_m(self) -> float:
        return math.dist(self.start, self.end)


@dataclass(frozen=True)
class Bay:
    """A place to park: alongside the lane `lane` at arc length `s_m`, `left_m` to its left (negative: right), or, with
    its own `pose` (x, y, heading), anywhere."""

    lane: str
    s_m: float
    left_m: float
    pose: tuple[float, float, float]


@dataclass(frozen=True)
class Conflict:
    """Where one lane comes too close to another: arc lengths [start, end] on each."""

    other: str
    here: tuple[float, float]
    there: tuple[float, float]


@dataclass(frozen=True)
class Network:
    """Lanes by name; routes by "from-to/lane" as names of lanes in order. Lane 0 is the rightmost."""

    lanes: dict[str, Lane]
    routes: dict[str, tuple[str, ...]]
    crossings: tuple[Crossing, ...] = ()
    bays: tuple[Bay, ...] = ()
    walks: tuple[Path, ...] = ()  # along the pavements
    entries: dict[str, tuple[str, ...]] = field(default_factory=dict)  # where traffic flows in: routes by first lane

    def route_path(self, route: str) -> Path:
        return Path(tuple(piece for name in self.routes[self.full(route)] for piece in self.lanes[name].path.pieces))

    def full(self, route: str) -> str:
        """The route's name with its lane: "west-east" is "west-east/0", or the only lane it has."""
        if route in self.routes:
            return route
        return next(name for name in self.routes if name.split("/")[0] == route)

    def stop_line_m(self, route: str) -> float:
        """Arc length of the first stop line along the route: the start of its first junction lane, or 0 without."""
        at = 0.0
        for name in self.routes[self.full(route)]:
            if self.lanes[name].junction:
                return at
            at += self.lanes[name].path.length_m
        return 0.0

    @cached_property
    def conflicts(self) -> dict[str, tuple[Conflict, ...]]:
        """For each junction lane, the junction lanes that it must not share the road with. Lanes that only part from
        the same lane are none: the follower there follows."""
        names = [name for name, lane in self.lanes.items() if lane.junction]
        samples = {name: self._samples(name) for name in names}
        starts = {name: self.lanes[name].path.points(np.array(0.0)) for name in names}
        found: dict[str, list[Conflict]] = {name: [] for name in names}
        for i, a in enumerate(names):
            for b in names[i + 1 :]:
                together = np.hypot(*(starts[a] - starts[b])) < 0.1
                if together or self.lanes[a].level_m != self.lanes[b].level_m:
                    continue
                spans = _too_close(*samples[a], *samples[b])
                if spans is not None:
                    found[a].append(Conflict(b, spans[0], spans[1]))
                    found[b].append(Conflict(a, spans[1], spans[0]))
        return {name: tuple(conflicts) for name, conflicts in found.items()}

    @cached_property
    def swept(self) -> dict[str, tuple[Conflict, ...]]:
        """For each junction lane, those that two long vehicles cannot use side by side though their centre lines keep
        clear: in a bend the corners and the tail of a bus sweep over more than its width."""
        names = [name for name, lane in self.lanes.items() if lane.junction]
        bodies = {name: self._long_bodies(name) for name in names}
        together = {frozenset(pair) for lanes in self.routes.values() for pair in itertools.combinations(lanes, 2)}
        found: dict[str, list[Conflict]] = {name: [] for name in names}
        for i, a in enumerate(names):
            known = {a, *(conflict.other for conflict in self.conflicts[a]), *(b for b, _ in self.partings[a])}
            for b in names[i + 1 :]:
                # On the lanes of one route they follow one another.
                if b in known or {a, b} in together or self.lanes[a].level_m != self.lanes[b].level_m:
                    continue
                spans = _touching(bodies[a], bodies[b])
                if spans is not None:
                    found[a].append(Conflict(b, spans[0], spans[1]))
                    found[b].append(Conflict(a, spans[1], spans[0]))
        return {name: tuple(conflicts) for name, conflicts in found.items()}

    def _long_bodies(self, name: str) -> tuple[Array, Array, Array]:
        """Arc lengths on a lane [S], centres [S, 2] and headings [S] of a bus whose body is on it."""
        route = next(route for route, lanes in self.routes.items() if name in lanes)
        start = sum(self.lanes[lane].path.length_m for lane in self.routes[route][: self.routes[route].index(name)])
        length, reach = self.lanes[name].path.length_m, 0.5 * LONGEST.length_m
        s = np.linspace(-reach, length + reach, math.ceil((length + 2 * reach) / SWEPT_SAMPLE_M) + 1)
        return s, *self.route_path(route).axle_pose(start + s, LONGEST.wheelbase_m)

    @cached_property
    def partings(self) -> dict[str, tuple[tuple[str, float], ...]]:
        """For each junction lane, the others that start where it does, and up to which arc length they are close."""
        names = [name for name, lane in self.lanes.items() if lane.junction]
        samples = {name: self._samples(name) for name in names}
        found: dict[str, list[tuple[str, float]]] = {name: [] for name in names}
        for a in names:
            for b in names:
                if a == b or np.hypot(*(samples[a][1][0] - samples[b][1][0])) > 0.1:
                    continue
                count = min(len(samples[a][0]), len(samples[b][0]))
                near = np.hypot(*(samples[a][1][:count] - samples[b][1][:count]).T) < CLEAR_M
                found[a].append((b, float(samples[a][0][np.flatnonzero(near)[-1]])))
        return {name: tuple(pairs) for name, pairs in found.items()}

    @cached_property
    def walked(self) -> dict[str, tuple[tuple[int, float, float], ...]]:
        """For each lane, the crossings over it: (index of the crossing, start, end) in arc length."""
        found: dict[str, tuple[tuple[int, float, float], ...]] = {}
        for name in self.lanes:
            s, points = self._samples(name)
            spans = []
            for index, crossing in enumerate(self.crossings):
                if crossing.level_m != self.lanes[name].level_m:
                    continue
                ax, ay = crossing.start
                ux, uy = (crossing.end[0] - ax) / crossing.length_m, (crossing.end[1] - ay) / crossing.length_m
                along = (points[:, 0] - ax) * ux + (points[:, 1] - ay) * uy
                across = -(points[:, 0] - ax) * uy + (points[:, 1] - ay) * ux
                on = (along > -0.5) & (along < crossing.length_m + 0.5)
                on &= np.abs(across) < 0.5 * crossing.width_m + WALKER_M
                if on.any():
                    spans.append((index, float(s[on][0]), float(s[on][-1])))
            found[name] = tuple(spans)
        return found

    def _samples(self, name: str) -> tuple[Array, Array]:
        path = self.lanes[name].path
        s = np.linspace(0, path.length_m, max(2, math.ceil(path.length_m / SAMPLE_M) + 1))
        return s, path.points(s)


def _too_close(s: Array, p: Array, t: Array, q: Array) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """The spans of two sampled curves that are nearer to each other than `CLEAR_M`."""
    gaps = np.hypot(p[:, None, 0] - q[None, :, 0], p[:, None, 1] - q[None, :, 1]) < CLEAR_M
    if not gaps.any():
        return None
    here, there = s[gaps.any(axis=1)], t[gaps.any(axis=0)]
    return (float(here[0]), float(here[-1])), (float(there[0]), float(there[-1]))


def _touching(
    a: tuple[Array, Array, Array], b: tuple[Array, Array, Array]
) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """The spans of two lanes on which two of the longest bodies touch: separating axes of rectangles."""
    half = 0.5 * np.array([LONGEST.length_m, LONGEST.width_m]) + 0.5 * SWEPT_MARGIN_M
    between = b[1][None] - a[1][:, None]  # [S, T, 2]
    apart = np.zeros(between.shape[:2], dtype=bool)
    axes = [np.stack([[np.cos(h), np.sin(h)], [-np.sin(h), np.cos(h)]]).transpose(2, 0, 1) for h in (a[2], b[2])]
    for direction in (axes[0][:, None], axes[1][None]):  # [S or 1, T or 1, 2 axes, 2]
        distance = np.abs((direction * between[:, :, None]).sum(axis=-1))
        for_a = np.abs(np.einsum("...ix,...jx->...ij", direction, axes[0][:, None])) @ half
        for_b = np.abs(np.einsum("...ix,...jx->...ij", direction, axes[1][None])) @ half
        apart |= (distance > for_a + for_b).any(axis=-1)
    if apart.all():
        return None
    here, there = a[0][~apart.all(axis=1)], b[0][~apart.all(axis=0)]
    return (float(here[0]), float(here[-1])), (float(there[0]), float(there[-1]))
