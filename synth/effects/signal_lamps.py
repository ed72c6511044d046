"""The lamps of the traffic lights shine: appearance that changes without motion. Each lamp is an instance."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from synth.checking import key
from synth.city.layout import Placement
from synth.city.mesh import turn
from synth.errors import InputError
from synth.glow import disc_mesh, make_glow
from synth.staging import Extras, Staging
from synth.traffic.signals import Intervals, is_green

STAGE = "scene"
COST = "two small meshes for each signal"
TRUTH = "every lamp has an id; activity: a lamp that switches is appearance-only"

Array = NDArray[np.float64]
COLOURS = {"red": (1.0, 0.03, 0.02), "green": (0.02, 1.0, 0.35)}
HEIGHTS_M = {"red": 2.95, "green": 2.4}  # of the lowest point, above the foot of the post
FACE_M = 0.2  # from the axis of the post to the lamps


@dataclass(frozen=True, kw_only=True)
class Settings:
    radius_m: float = key("of a lamp", unit="meters", range=(0.05, 1), default=0.15)
    strength: float = key("brightness of a lamp that is on", range=(0, 1000), default=12.0)


class SignalLamps(Staging):
    def __init__(self, settings: Settings, plan: Any) -> None:
        self.settings, self.signal = settings, plan.scene.signal
        posts = [placement for placement in plan.city.placements if placement.mesh == "signal"]
        self.lamps = [(post, colour) for post in posts for colour in COLOURS]
        self._extras = self._make_extras()

    def _make_extras(self) -> Extras:
        disc, count = disc_mesh(self.settings.radius_m), len(self.lamps)
        poses = np.stack([self._pose(*lamp) for lamp in self.lamps]) if count else np.empty((0, 4, 4))
        size = np.tile([0.02, 2 * self.settings.radius_m, 2 * self.settings.radius_m], (count, 1))
        names = tuple(f"signal-{colour}-{k:02d}" for k, (_, colour) in enumerate(self.lamps, start=1))
        stands = np.zeros(count)
        return Extras(
            names, ("signal-lamp",) * count, size, (disc,) * count, lambda _: poses, lambda _: stands, self.lit
        )

    def _pose(self, post: Placement, colour: str) -> Array:
        """The lamps are where the post looks to: to those who wait at the line."""
        pose = np.eye(4)
        pose[:3, :3] = turn(post.angle)
        pose[:3, 3] = np.array(post.position) + pose[:3, :3] @ [FACE_M, 0.0, HEIGHTS_M[colour]]
        return pose

    def _intervals(self, post: Placement) -> Intervals:
        """Green times of those who come along the street that the post looks along."""
        along_x = abs(math.cos(post.angle)) > abs(math.sin(post.angle))
        intervals: Intervals = self.signal.east_west_green_s if along_x else self.signal.north_south_green_s
        return intervals

    def lit(self, time_s: float) -> NDArray[np.bool_]:
        shines = [is_green(self._intervals(post), time_s) == (colour == "green") for post, colour in self.lamps]
        return np.array(shines, dtype=bool)

    def extras(self) -> Extras:
        return self._extras

    def build(self, stage: Any) -> None:
        colours = [COLOURS[colour] for _, colour in self.lamps]
        make_glow(stage.data, stage.objects_of(self._extras), colours, self.settings.strength)


def stage(settings: Settings, plan: Any) -> SignalLamps:
    """Raises InputError for a scene without signals."""
    if plan.scene.signal is None:
        raise InputError("effects.signal_lamps: the scene has no [signal]; add one, or leave the effect out.")
    return SignalLamps(settings, plan)
