"""Noise of the sensor in linear light: photons arrive one by one (Poisson), reading them adds a little (Gauss)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from synth.checking import key
from synth.seeds import generator

STAGE = "film"
COST = "one random number of each kind a channel"
TRUTH = "none"


@dataclass(frozen=True, kw_only=True)
class Settings:
    full_well_e: float = key("electrons of a white pixel: fewer is noisier", range=(10, 1e7), default=4000.0)
    read_noise_e: float = key("standard deviation of reading", unit="electrons", range=(0, 1e4), default=6.0)


def expose(settings: Settings, linear: NDArray[np.float32], shot: Any) -> NDArray[np.float32]:
    rng = generator(shot.seed, f"sensor noise {shot.frame.name}")
    electrons = np.clip(linear.astype(np.float64), 0, 1) * settings.full_well_e
    counted = rng.poisson(electrons) + rng.normal(scale=settings.read_noise_e, size=electrons.shape)
    return np.asarray(counted / settings.full_well_e, dtype=np.float32)
