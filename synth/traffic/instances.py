"""All road users of a scene as instances: an id, a kind, a paint, and a pose and speed at any real time."""

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from synth.errors import InputError
from synth.seeds import generator
from synth.traffic.fleet import BODIES, Paint
from synth.traffic.network import Network
from synth.traffic.population import Amends, Parked, Population, draw_paint, populate
from synth.traffic.settings import Flow, Parking, Pedestrians, Traffic, Vehicle
from synth.traffic.signals import Intervals
from synth.traffic.simulation import Drives, simulate
from synth.traffic.tracks import Tracks

Array = NDArray[np.float64]
Origin = tuple[str, int]  # "placed", "car", "walker", "track" or "parked", and which of them

MOVING_MPS = 0.05  # docs/formats.md: above this speed an instance is moving
CLEARANCE_M = 0.1  # bodies closer than this count as overlapping
CHECK_EVERY_S = 0.1


@dataclass(frozen=True)
class Instance:
    """A road user. Ids count from 1; 0 is the background. `paint` is linear RGB."""

    id: int
    name: str
    kind: str
    paint: Paint


class Movers(Protocol):
    """A group of road users; arrays over its members."""

    @property
    def kinds(self) -> tuple[str, ...]: ...

    def poses(self, time_s: float) -> tuple[Array, Array]:
        """Centres [M, 2] and headings [M]."""
        ...

    def heights(self, time_s: float) -> Array: ...

    def speeds(self, time_s: float) -> Array: ...

    def here(self, time_s: float) -> NDArray[np.bool_]: ...


@dataclass(frozen=True)
class Standing:
    """Parked vehicles as a group."""

    parked: tuple[Parked, ...]

    @property
    def kinds(self) -> tuple[str, ...]:
        return tuple(p.kind for p in self.parked)

    def poses(self, time_s: float) -> tuple[Array, Array]:  # noqa: ARG002 - as in every group
        return np.array([p.centre for p in self.parked]).reshape(-1, 2), np.array([p.heading for p in self.parked])

    def heights(self, time_s: float) -> Array:  # noqa: ARG002
        return np.array([p.level_m for p in self.parked])

    def speeds(self, time_s: float) -> Array:  # noqa: ARG002
        return np.zeros(len(self.parked))

    def here(self, time_s: float) -> NDArray[np.bool_]:  # noqa: ARG002
        return np.ones(len(self.parked), dtype=bool)


@dataclass(frozen=True)
class Fleet:
    """Those that can move first, then the parked ones; arrays over instances keep this order. `notes`: what a user
    should know about how they came about, in sentences."""

    instances: tuple[Instance, ...]
    groups: tuple[Movers, ...]
    notes: tuple[str, ...] = ()

    def object_to_world(self, time_s: float) -> Array:
        """Rigid poses [M, 4, 4]: origin at the centre of the footprint, x forward, z up."""
        parts = [group.poses(time_s) for group in self.groups]
        centres = np.concatenate([centre for centre, _ in parts])
        headings = np.concatenate([heading for _, heading in parts])
        cos, sin = np.cos(headings), np.sin(headings)
        poses = np.tile(np.eye(4), (len(headings), 1, 1))
        poses[:, 0, 0], poses[:, 0, 1] = cos, -sin
        poses[:, 1, 0], poses[:, 1, 1] = sin, cos
        poses[:, :2, 3] = centres
        poses[:, 2, 3] = np.concatenate([group.heights(time_s) for group in self.groups])
        return poses

    def speed_mps(self, time_s: float) -> Array:
        """Speeds [M]; 0 where an instance is not present."""
        speeds = np.concatenate([group.speeds(time_s) for group in self.groups])
        return np.where(self.present(time_s), speeds, 0.0)

    def moving(self, time_s: float) -> NDArray[np.bool_]:
        """Which instances move [M]."""
        return self.speed_mps(time_s) > MOVING_MPS

    def present(self, time_s: float) -> NDArray[np.bool_]:
        """Which instances are in the scene [M]: not before they enter and not after they have left."""
        return np.concatenate([group.here(time_s) for group in self.groups])


def build_fleet(network: Network, vehicles: tuple[Vehicle, ...], flows: tuple[Flow, ...], traffic: Traffic,
                parking: Parking, people: Pedestrians, lights: Mapping[str, Intervals] | None, seed: int,
                duration_s: float, tracks: Tracks | None = None) -> Fleet:  # fmt: skip
    """Simulate who drives and walks, park the others, and check that no two ever overlap.

    Whom the seed has put there gives way to whom the scene has: of two who would touch, one that was drawn walks
    another way or is left out, and the rest is simulated again.

    Raises:
        InputError: two vehicles overlap that the scene places, or it asks for what the street does not have.
    """
    amends = Amends()
    while True:
        population = populate(network, vehicles, flows, traffic, parking, people, seed, duration_s, amends)
        warm_up = traffic.warm_up_s if flows or parking.arriving else 0.0
        drives = simulate(network, population.cars, population.walkers, lights, traffic, -warm_up, duration_s)
        fleet, origins = _fleet(population, drives, tracks, len(vehicles), amends, seed)
        clashes = overlaps(fleet, duration_s, _may_touch(origins, tracks))
        amended = amend(amends, [(origins[i], origins[j]) for i, j, _ in clashes], people.crossing)
        if amended == amends:
            break
        amends = amended
    if clashes:
        _refuse(fleet, clashes[0])
    if amends == Amends():
        return fleet
    note = (
        f"traffic: of those drawn from the seed {amends.left_out} were left out and {len(amends.turned)} on foot walk "
        "another way, because they would have touched others."
    )
    return dataclasses.replace(fleet, notes=(*fleet.notes, note))


def _fleet(population: Population, drives: Drives, tracks: Tracks | None, placed: int, amends: Amends,
           seed: int) -> tuple[Fleet, list[Origin]]:  # fmt: skip
    """The fleet, and where each of its instances comes from."""
    shown = drives.present.any(axis=0)
    groups: list[Movers] = [drives.only(shown), Standing(population.parked)]
    described = [d for d, show in zip(_described(population, drives), shown, strict=True) if show]
    origins: list[Origin] = [("placed" if car.number < placed else "car", car.number) for car in population.cars]
    origins += [("walker", walker.number) for walker in population.walkers]
    origins = [origin for origin, show in zip(origins, shown, strict=True) if show]
    described += [(p.kind, "parked", None) for p in population.parked]
    places = (place for place in itertools.count() if place not in amends.parked)
    parked: list[Origin] = [("parked", place) for place, _ in zip(places, population.parked, strict=False)]
    if tracks is not None:
        groups.insert(1, tracks)
        described[len(origins) : len(origins)] = [(t.kind, f"track-{_plain(t.name)}", None) for t in tracks.tracks]
        origins += [("track", number) for number in range(len(tracks.tracks))]
    rng = generator(seed, "paints")
    instances = []
    for number, (kind, where, colour) in enumerate(described, start=1):
        drawn = draw_paint(kind, rng)
        instances.append(Instance(number, f"{where}-{kind}-{number:03d}", kind, colour or drawn))
    notes = tracks.notes if tracks is not None else ()
    return Fleet(tuple(instances), tuple(groups), notes), origins + parked


def _may_touch(origins: list[Origin], tracks: Tracks | None) -> range:
    """The indices of those who may touch each other."""
    of_tracks = [index for index, (what, _) in enumerate(origins) if what == "track"]
    return range(of_tracks[0], of_tracks[-1] + 1) if of_tracks and tracks is not None and tracks.may_touch else range(0)


def amend(amends: Amends, clashes: Sequence[tuple[Origin, Origin]], crossing: int) -> Amends:
    """Amends with one more for every pair that touches: of two, someone on foot walks another way, then is left out;
    else a vehicle that was drawn is left out, the later one of two. Those before `crossing` can walk another way."""
    order = ("walker", "car", "parked")
    turned, gone = set(amends.turned), {name: set[int]() for name in order}
    for pair in clashes:
        drawn = [origin for origin in pair if origin[0] in order]
        if not drawn or any(number in gone[what] for what, number in drawn):
            continue
        what, number = min(drawn, key=lambda origin: (order.index(origin[0]), -origin[1]))
        if what == "walker" and number < crossing and number not in amends.turned:
            turned.add(number)
        elif not (what == "walker" and number in turned - amends.turned):  # who has just been turned is tried first
            gone[what].add(number)
    return Amends(frozenset(turned), amends.walkers | gone["walker"], amends.cars | gone["car"],
                  amends.parked | gone["parked"])  # fmt: skip


def _described(population: Population, drives: Drives) -> list[tuple[str, str, Paint | None]]:
    where = [*population.where, *["walking"] * len(population.walkers)]
    colours = [*population.colours, *[None] * len(population.walkers)]
    return list(zip(drives.kinds, where, colours, strict=True))


def _plain(name: str) -> str:
    """The id of somebody else's table as a part of a name."""
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in name)[:40]


def overlaps(fleet: Fleet, duration_s: float, may_touch: range = range(0)) -> list[tuple[int, int, float]]:
    """Pairs of indices that overlap at some time, checked ten times a second, with the first such time; those at the
    indices `may_touch` may overlap each other."""
    found: dict[tuple[int, int], float] = {}
    for time_s in np.linspace(0.0, duration_s, max(2, round(duration_s / CHECK_EVERY_S) + 1)):
        for pair in overlapping(fleet, float(time_s)):
            if not all(i in may_touch for i in pair):
                found.setdefault(pair, float(time_s))
    return [(*pair, time_s) for pair, time_s in found.items()]


def _refuse(fleet: Fleet, clash: tuple[int, int, float]) -> None:
    first, second = (fleet.instances[i].name for i in clash[:2])
    if "track-" in (first[:6], second[:6]):
        advice = 'give one a smaller kind in the table of tracks, or set tracks.overlaps = "allow"'
    else:
        advice = "change the position, speed or route of one"
    raise InputError(f"vehicles: {first} and {second} overlap at {clash[2]:.1f} s; {advice}.")


def overlapping(fleet: Fleet, time_s: float) -> list[tuple[int, int]]:
    """Pairs of indices whose footprints are closer than the clearance: separating axes of two rectangles.

    People on foot are tested against vehicles, not against each other. What is far apart in x is never compared: tens
    of thousands of instances take a second.
    """
    poses = fleet.object_to_world(time_s)
    half = np.array([BODIES[i.kind].dimensions_m[:2] for i in fleet.instances]).reshape(-1, 2) * 0.5
    present = np.flatnonzero(fleet.present(time_s))
    on_foot = np.array([i.kind == "pedestrian" for i in fleet.instances], dtype=bool)
    reach = np.hypot(*half.T)
    order = present[np.argsort(poses[present, 0, 3], kind="stable")]
    pairs = []
    for step in range(1, len(order)):
        first, second = order[:-step], order[step:]
        between = poses[second, :3, 3] - poses[first, :3, 3]
        widest = 2 * reach.max() + CLEARANCE_M
        if between[:, 0].min() > widest:
            break
        near = np.hypot(between[:, 0], between[:, 1]) <= reach[first] + reach[second] + CLEARANCE_M
        near &= (np.abs(between[:, 2]) < 2.0) & ~(on_foot[first] & on_foot[second])
        for i, j in zip(first[near].tolist(), second[near].tolist(), strict=True):
            if _touch(poses[i], half[i], poses[j], half[j]):
                pairs.append((min(i, j), max(i, j)))
    return sorted(pairs)


def _touch(a: Array, half_a: Array, b: Array, half_b: Array) -> bool:
    between = (b - a)[:2, 3]
    if not math.isfinite(float(between.sum())):
        return True
    axes_a, axes_b = a[:2, :2].T, b[:2, :2].T  # the first points forward
    directions = np.concatenate([axes_a, axes_b])  # [4, 2]
    spread = np.abs(directions @ axes_a.T) @ half_a + np.abs(directions @ axes_b.T) @ half_b
    return bool(np.all(np.abs(directions @ between) < spread + CLEARANCE_M))
