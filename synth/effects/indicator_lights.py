"""Vehicles show what they do: brake lights, and indicators that blink before and in a turn. Each is an instance."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from synth.checking import key
from synth.glow import block_mesh, make_glow
from synth.staging import Extras, Staging
from synth.traffic.fleet import BODIES

STAGE = "scene"
COST = "a small mesh for each lamp that is ever lit"
TRUTH = "every lamp has an id; activity: on a vehicle that stands, a lamp that switches is appearance-only"

Array = NDArray[np.float64]
BRAKE, INDICATOR = (1.0, 0.01, 0.01), (1.0, 0.28, 0.01)  # linear RGB
LIT = ("car", "van", "bus", "truck")
STEP_S = 0.1  # at which the drive is looked up
TURN_RAD, AHEAD_S = 0.25, 2.5  # a change of heading within that time ahead is announced
BRAKING_MPS2 = 0.4


@dataclass(frozen=True, kw_only=True)
class Settings:
    size_m: float = key("width of a lamp", unit="meters", range=(0.05, 1), default=0.3)
    strength: float = key("brightness of a lamp that is on", range=(0, 1000), default=10.0)
    blinks_hz: float = key("of the indicators", unit="1/s", range=(0.5, 5), default=1.5)


@dataclass(frozen=True)
class Lamp:
    """On vehicle number `vehicle`; `states` [T] over the looked-up times: asked to shine."""

    vehicle: int
    name: str
    offset_m: tuple[float, float, float]
    blinks: bool
    states: NDArray[np.bool_]


class IndicatorLights(Staging):
    def __init__(self, settings: Settings, plan: Any) -> None:
        self.settings, self.fleet = settings, plan.fleet
        self.last_s = plan.frames[-1].time_s
        self.lamps = self._lamps()
        depth, height = 0.06, 0.5 * settings.size_m
        mesh, count = block_mesh(depth, settings.size_m, height), len(self.lamps)
        size = np.tile([depth, settings.size_m, height], (count, 1))
        names = tuple(f"{self.fleet.instances[lamp.vehicle].name}-{lamp.name}" for lamp in self.lamps)
        self._extras = Extras(names, ("indicator",) * count, size, (mesh,) * count, self.object_to_world,
                              self.speed_mps, self.lit, self.present)  # fmt: skip

    def _lamps(self) -> list[Lamp]:
        """Those that are lit at some time of the clip."""
        times = np.arange(0, self.last_s + AHEAD_S + STEP_S, STEP_S)
        inside = times <= self.last_s + STEP_S
        poses = np.stack([self.fleet.object_to_world(min(float(t), self.last_s)) for t in times])
        speed = np.stack([self.fleet.speed_mps(min(float(t), self.last_s)) for t in times])
        heading = np.unwrap(np.arctan2(poses[:, :, 1, 0], poses[:, :, 0, 0]), axis=0)
        ahead = round(AHEAD_S / STEP_S)
        turning = heading[np.minimum(np.arange(len(times)) + ahead, len(times) - 1)] - heading
        braking = np.gradient(speed, STEP_S, axis=0) < -BRAKING_MPS2
        found = []
        for number, instance in enumerate(self.fleet.instances):
            body = BODIES[instance.kind]
            if body.label not in LIT:
                continue
            x, y, z = 0.5 * body.length_m + 0.02, 0.36 * body.width_m, 0.42 * body.height_m
            kinds: list[tuple[str, bool, tuple[float, ...], NDArray[np.bool_], tuple[int, ...]]]
            kinds = [("brake", False, (0.0,), braking[:, number], (1, -1))]
            kinds += [(f"turn-{name}", True, (1.0, 0.0), side * turning[:, number] > TURN_RAD, (side,))
                      for name, side in (("left", 1), ("right", -1))]  # fmt: skip
            for name, blinks, ends, states, sides in kinds:
                if states[inside].any():
                    found += [
                        Lamp(number, f"{name}-{'front' if end else 'rear'}-{'left' if side > 0 else 'right'}",
                             (x if end else -x, side * y, z if name == "brake" else z - 0.2), blinks, states)
                        for end in ends for side in sides
                    ]  # fmt: skip
        return found

    def object_to_world(self, time_s: float) -> Array:
        vehicles = self.fleet.object_to_world(time_s)
        poses = np.tile(np.eye(4), (len(self.lamps), 1, 1))
        for pose, lamp in zip(poses, self.lamps, strict=True):
            offset = np.eye(4)
            offset[:3, 3] = lamp.offset_m
            pose[:] = vehicles[lamp.vehicle] @ offset
        return poses

    def speed_mps(self, time_s: float) -> Array:
        return self.fleet.speed_mps(time_s)[[lamp.vehicle for lamp in self.lamps]]

    def present(self, time_s: float) -> NDArray[np.bool_]:
        return self.fleet.present(time_s)[[lamp.vehicle for lamp in self.lamps]]

    def lit(self, time_s: float) -> NDArray[np.bool_]:
        step = round(time_s / STEP_S)
        shows = math.floor(2 * self.settings.blinks_hz * time_s + 1e-9) % 2 == 0
        return np.array([lamp.states[step] and (shows or not lamp.blinks) for lamp in self.lamps], dtype=bool)

    def extras(self) -> Extras:
        return self._extras

    def build(self, stage: Any) -> None:
        colours = [INDICATOR if lamp.blinks else BRAKE for lamp in self.lamps]
        make_glow(stage.data, stage.objects_of(self._extras), colours, self.settings.strength)


def stage(settings: Settings, plan: Any) -> IndicatorLights:
    return IndicatorLights(settings, plan)
