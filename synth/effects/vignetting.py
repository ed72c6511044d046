"""The lens passes less light towards the corners."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from synth.camera import pixel_centres
from synth.checking import key

STAGE = "film"
COST = "one product a pixel"
TRUTH = "none"


@dataclass(frozen=True, kw_only=True)
class Settings:
    corner_stops: float = key("light lost in the corners", unit="stops", range=(0, 6), default=0.6)


def expose(settings: Settings, linear: NDArray[np.float32], shot: Any) -> NDArray[np.float32]:  # noqa: ARG001
    height, width = linear.shape[:2]
    from_centre = pixel_centres(width, height) - [0.5 * width, 0.5 * height]
    squared_radius = (from_centre**2).sum(axis=-1) / (0.25 * (width**2 + height**2))
    return np.asarray(linear * np.exp2(-settings.corner_stops * squared_radius)[..., None], dtype=np.float32)
