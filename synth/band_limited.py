"""Random motion with a given spectrum: a smooth function of time, the same at any real time and frame rate."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
WAVES = 24


@dataclass(frozen=True)
class BandLimited:
    """A sum of sine waves whose frequencies are spread evenly over a band; one column a channel."""

    frequency_hz: Array  # [WAVES, C]
    phase: Array  # [WAVES, C]
    amplitude: float

    def __call__(self, time_s: float) -> Array:
        """Values [C] at a time."""
        waves = np.sin(2 * np.pi * self.frequency_hz * time_s + self.phase)
        return np.asarray(self.amplitude * waves.sum(axis=0))


def band_limited(rng: np.random.Generator, channels: int, rms: float, band_hz: tuple[float, float]) -> BandLimited:
    """Channels that each have the given root mean square over a long time."""
    low, high = band_hz
    share = (np.arange(WAVES)[:, None] + rng.random((WAVES, channels))) / WAVES
    phase = rng.uniform(0, 2 * np.pi, (WAVES, channels))
    return BandLimited(low + (high - low) * share, phase, rms * np.sqrt(2 / WAVES))
