"""All vehicles of a scene as instances: an id, a kind, a paint, and a pose and speed at any real time."""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from synth.errors import InputError
from synth.seeds import generator
from synth.spec import Kind, Scene
from synth.traffic.fleet import BODIES, PAINTS
from synth.traffic.network import crossroads
from synth.traffic.parking import Parked, park
from synth.traffic.simulation import Drives, simulate

Array = NDArray[np.float64]
Paint = tuple[float, float, float]

MOVING_MPS = 0.05  # docs/formats.md: above this speed an instance is moving
CLEARANCE_M = 0.1  # bodies closer than this count as overlapping


@dataclass(frozen=True)
class Instance:
    """A vehicle. Ids count from 1; 0 is the background. `paint` is linear RGB."""

    id: int
    name: str
    kind: Kind
    paint: Paint


@dataclass(frozen=True)
class Fleet:
    """Driven vehicles first, then the parked ones; arrays over instances keep this order."""

    instances: tuple[Instance, ...]
    drives: Drives
    parked: tuple[Parked, ...]

    def object_to_world(self, time_s: float) -> Array:
        """Rigid poses [M, 4, 4]: origin at the centre of the footprint, x forward, z up."""
        centres, headings = self.drives.poses(time_s)
        centres = np.concatenate([centres, np.array([p.centre for p in self.parked]).reshape(-1, 2)])
        headings = np.concatenate([headings, np.array([p.heading for p in self.parked])])
        cos, sin = np.cos(headings), np.sin(headings)
        poses = np.tile(np.eye(4), (len(headings), 1, 1))
        poses[:, 0, 0], poses[:, 0, 1] = cos, -sin
        poses[:, 1, 0], poses[:, 1, 1] = sin, cos
        poses[:, :2, 3] = centres
        return poses

    def speed_mps(self, time_s: float) -> Array:
        """Speeds [M]."""
        return np.concatenate([self.drives.state(time_s)[1], np.zeros(len(self.parked))])

    def moving(self, time_s: float) -> NDArray[np.bool_]:
        """Which instances move [M]."""
        return self.speed_mps(time_s) > MOVING_MPS


def build_fleet(scene: Scene, duration_s: float) -> Fleet:
    """Simulate the driven vehicles, park the others, and check that no two ever overlap.

    Raises:
        InputError: two vehicles overlap.
    """
    drives = simulate(crossroads(scene.street), scene.vehicles, scene.signal, scene.traffic, duration_s)
    parked = park(scene.street, scene.traffic.parked_share, generator(scene.seed, "parking"))
    paints = generator(scene.seed, "paints")
    weights = np.array([weight for _, weight in PAINTS])
    instances = []
    described: list[tuple[Kind, str, Paint | None]] = [
        (vehicle.kind, vehicle.route, vehicle.colour) for vehicle in scene.vehicles
    ]
    described += [(vehicle.kind, "parked", None) for vehicle in parked]
    for number, (kind, where, colour) in enumerate(described, start=1):
        drawn = PAINTS[paints.choice(len(PAINTS), p=weights / weights.sum())][0]
        instances.append(Instance(number, f"{where}-{kind}-{number:03d}", kind, colour or drawn))
    fleet = Fleet(tuple(instances), drives, parked)
    for time_s in np.linspace(0.0, duration_s, max(2, round(duration_s / 0.1) + 1)):
        clash = overlapping(fleet, float(time_s))
        if clash:
            first, second = (fleet.instances[i].name for i in clash[0])
            raise InputError(
                f"vehicles: {first} and {second} overlap at {time_s:.1f} s; change the position, speed or route of one."
            )
    return fleet


def overlapping(fleet: Fleet, time_s: float) -> list[tuple[int, int]]:
    """Pairs of indices whose footprints are closer than the clearance: separating axes of two rectangles."""
    poses = fleet.object_to_world(time_s)
    half = np.array([BODIES[i.kind].dimensions_m[:2] for i in fleet.instances]).reshape(-1, 2) * 0.5
    centres, axes = poses[:, :2, 3], poses[:, :2, :2].transpose(0, 2, 1)  # axes[m, 0] points forward
    reach = np.hypot(*half.T)
    pairs = []
    for i, j in itertools.combinations(range(len(poses)), 2):
        between = centres[j] - centres[i]
        if np.hypot(*between) > reach[i] + reach[j] + CLEARANCE_M:
            continue
        directions = np.concatenate([axes[i], axes[j]])  # [4, 2]
        spread = np.abs(directions @ axes[i].T) @ half[i] + np.abs(directions @ axes[j].T) @ half[j]
        if np.all(np.abs(directions @ between) < spread + CLEARANCE_M):
            pairs.append((i, j))
    return pairs
