"""The poses that a reconstruction is given are measured: GNSS positions that wander, attitudes that scatter.

The capture's `viewmat` is the measured pose, `viewmat_true` the one that the truth belongs to.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from synth.camera import invert_rigid
from synth.checking import key
from synth.rotations import rotation
from synth.seeds import generator

STAGE = "capture"
COST = "nothing"
TRUTH = "true poses are written beside the measured ones"

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Settings:
    horizontal_m: float = key("standard deviation east and north", unit="meters", range=(0, 100), default=0.3)
    vertical_m: float = key("standard deviation of the height", unit="meters", range=(0, 100), default=0.6)
    attitude_deg: float = key("standard deviation about each axis", unit="degrees", range=(0, 30), default=0.1)
    correlation_s: float = key("how fast the position's error wanders", unit="seconds", range=(0, 1e5), default=30.0)


def measure(settings: Settings, plan: Any) -> Array:
    """World to camera [N, 4, 4]: a Gauss-Markov position error, an independent attitude error in every frame."""
    rng = generator(plan.scene.seed, "pose noise")
    spread = np.array([settings.horizontal_m, settings.horizontal_m, settings.vertical_m])
    interval = 1 / plan.scene.time.fps
    kept = math.exp(-interval / settings.correlation_s) if settings.correlation_s > 0 else 0.0
    error, measured = rng.normal(size=3), []
    for frame in plan.frames:
        pose = invert_rigid(frame.viewmat)
        pose[:3, 3] += error * spread
        pose[:3, :3] = pose[:3, :3] @ rotation(rng.normal(size=3) * math.radians(settings.attitude_deg))
        measured.append(invert_rigid(pose))
        error = kept * error + math.sqrt(1 - kept**2) * rng.normal(size=3)
    return np.stack(measured)
