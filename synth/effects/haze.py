"""Aerial haze: what is far fades into the color of the air (Koschmieder's law)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from synth.checking import key

STAGE = "film"
COST = "one exponential a pixel"
TRUTH = "none; it reads the depth"

CONTRAST_AT_VISIBILITY = 0.02  # by definition of the meteorological visibility


@dataclass(frozen=True, kw_only=True)
class Settings:
    visibility_m: float = key(
        "distance at which 2 % of the contrast is left", unit="meters", range=(10, 1e6), default=600.0
    )
    colour: tuple[float, float, float] = key(
        "light of the air", unit="linear RGB", range=(0, 10), default=(0.60, 0.66, 0.74)
    )


def expose(settings: Settings, linear: NDArray[np.float32], shot: Any) -> NDArray[np.float32]:
    extinction = -np.log(CONTRAST_AT_VISIBILITY) / settings.visibility_m
    transmitted = np.exp(-extinction * shot.distance_m())[..., None]
    return np.asarray(linear * transmitted + np.array(settings.colour) * (1 - transmitted), dtype=np.float32)
