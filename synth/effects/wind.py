"""Trees sway about their foot. Each becomes an instance with a rigid pose, so that flow and activity know it."""

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from synth.band_limited import band_limited
from synth.checking import key
from synth.city.layout import City, Placement
from synth.city.mesh import turn
from synth.rotations import rotation
from synth.seeds import generator
from synth.staging import Extras, Staging

STAGE = "scene"
COST = "the trees' geometry is placed anew in every frame"
TRUTH = "every tree has an id, a pose and a speed"

Array = NDArray[np.float64]
STEP_S = 1e-3  # half of the difference quotient of the speed


@dataclass(frozen=True, kw_only=True)
class Settings:
    sway_deg: float = key("root mean square about each level axis", unit="degrees", range=(0, 20), default=1.0)
    lean_deg: float = key("how far the wind bends all trees", unit="degrees", range=(0, 30), default=1.0)
    direction_deg: float = key("where the wind blows to, from east", unit="degrees", range=(-360, 360), default=0.0)
    band_hz: tuple[float, float] = key("slowest and fastest part", unit="1/s", range=(0, 20), default=(0.2, 0.8))


class SwayingTrees(Staging):
    def __init__(self, settings: Settings, trees: list[Placement], city: City, seed: int) -> None:
        self.trees, self.meshes = trees, [city.props[tree.mesh] for tree in trees]
        channels = 2 * len(trees)
        waves = (generator(seed, "wind"), channels, math.radians(settings.sway_deg), settings.band_hz)
        self.sway = band_limited(*waves)
        blows = math.radians(settings.direction_deg)
        # Leaning towards (cos, sin) is a turn about (-sin, cos).
        self.lean = math.radians(settings.lean_deg) * np.array([-math.sin(blows), math.cos(blows)])
        reach = [np.abs(np.array(mesh.vertices)).max(axis=0) for mesh in self.meshes]
        scale = np.array([tree.scale for tree in trees])
        self.scale = scale
        self.dimensions_m = np.array(reach).reshape(-1, 3) * [2.0, 2.0, 1.0] * scale[:, None]

    def city(self, city: City) -> City:
        taken = set(map(id, self.trees))
        return dataclasses.replace(city, placements=tuple(p for p in city.placements if id(p) not in taken))

    def extras(self) -> Extras:
        count = len(self.trees)
        names = tuple(f"tree-{number:03d}" for number in range(1, count + 1))
        return Extras(names, ("tree",) * count, self.dimensions_m, tuple(self.meshes), self.object_to_world,
                      self.speed_mps, scales=tuple(self.scale.tolist()))  # fmt: skip

    def tilt(self, time_s: float) -> Array:
        """Rotation vectors about x and y [K, 2], radians."""
        return self.lean + self.sway(time_s).reshape(-1, 2)

    def object_to_world(self, time_s: float) -> Array:
        poses = np.tile(np.eye(4), (len(self.trees), 1, 1))
        for pose, tree, (x, y) in zip(poses, self.trees, self.tilt(time_s), strict=True):
            pose[:3, :3] = rotation(np.array([x, y, 0.0])) @ turn(tree.angle)
            pose[:3, 3] = tree.position
        return poses

    def speed_mps(self, time_s: float) -> Array:
        """Of the top of each tree."""
        rate = (self.tilt(time_s + STEP_S) - self.tilt(time_s - STEP_S)) / (2 * STEP_S)
        return np.asarray(np.linalg.norm(rate, axis=1) * self.dimensions_m[:, 2])


def stage(settings: Settings, plan: Any) -> SwayingTrees:
    trees = [placement for placement in plan.city.placements if placement.mesh.startswith("tree")]
    return SwayingTrees(settings, trees, plan.city, plan.scene.seed)
