"""The lamps of the traffic lights shine: appearance that changes without motion. Each lamp is an instance."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from synth.checking import key
from synth.city.mesh import turn
from synth.errors import InputError
from synth.glow import disc_mesh, make_glow
from synth.staging import Extras, Staging
from synth.traffic.network import ARMS
from synth.traffic.signals import is_green

STAGE = "scene"
COST = "two small meshes for each signal"
TRUTH = "every lamp has an id; activity: a lamp that switches is appearance-only"

Array = NDArray[np.float64]
COLOURS = {"red": (1.0, 0.03, 0.02), "green": (0.02, 1.0, 0.35)}
HEIGHTS_M = {"red": 2.95, "green": 2.4}  # of the lowest point, above the foot of the post
FACE_M = 0.2  # from the axis of the post to the lamps


@dataclass(frozen=True, kw_only=True)
class Settings:
    radius_m: float = key("of a lamp", unit="metres", range=(0.05, 1), default=0.15)
    strength: float = key("brightness of a lamp that is on", range=(0, 1000), default=12.0)


class SignalLamps(Staging):
    def __init__(self, settings: Settings, plan: Any) -> None:
        self.settings, self.signal = settings, plan.scene.signal
        posts = [placement for placement in plan.city.placements if placement.mesh == "signal"]
        # A post belongs to the arm that it stands along; its lamps face those who come along it.
        arms = [max(ARMS, key=lambda arm: float(np.dot(ARMS[arm], post.position[:2]))) for post in posts]
        self.lamps = [(post, arm, colour) for post, arm in zip(posts, arms, strict=True) for colour in COLOURS]
        self._extras = self._make_extras()

    def _make_extras(self) -> Extras:
        disc, count = disc_mesh(self.settings.radius_m), len(self.lamps)
        poses = np.stack([self._pose(*lamp) for lamp in self.lamps]) if count else np.empty((0, 4, 4))
        size = np.tile([0.02, 2 * self.settings.radius_m, 2 * self.settings.radius_m], (count, 1))
        names = tuple(f"signal-{arm}-{colour}-{k:02d}" for k, (_, arm, colour) in enumerate(self.lamps, start=1))
        stands = np.zeros(count)
        return Extras(
            names, ("signal-lamp",) * count, size, (disc,) * count, lambda _: poses, lambda _: stands, self.lit
        )

    def _pose(self, post: Any, arm: str, colour: str) -> Array:
        pose = np.eye(4)
        x, y = ARMS[arm]
        pose[:3, :3] = turn(float(np.arctan2(y, x)))
        pose[:3, 3] = np.add(post.position, (FACE_M * x, FACE_M * y, HEIGHTS_M[colour]))
        return pose

    def lit(self, time_s: float) -> NDArray[np.bool_]:
        return np.array([is_green(self.signal, arm, time_s) == (colour == "green") for _, arm, colour in self.lamps],
                        dtype=bool)  # fmt: skip

    def extras(self) -> Extras:
        return self._extras

    def build(self, stage: Any) -> None:
        colours = [COLOURS[colour] for _, _, colour in self.lamps]
        make_glow(stage.data, stage.objects_of(self._extras), colours, self.settings.strength)


def stage(settings: Settings, plan: Any) -> SignalLamps:
    """Raises InputError for a scene without signals."""
    if plan.scene.signal is None:
        raise InputError("effects.signal_lamps: the scene has no [signal]; add one, or leave the effect out.")
    return SignalLamps(settings, plan)
