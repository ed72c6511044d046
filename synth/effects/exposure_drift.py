"""Automatic exposure that wanders: the whole picture grows brighter and darker over seconds."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from synth.band_limited import band_limited
from synth.checking import key
from synth.seeds import generator

STAGE = "film"
COST = "one product a pixel"
TRUTH = "none"


@dataclass(frozen=True, kw_only=True)
class Settings:
    rms_stops: float = key("root mean square of the gain", unit="stops", range=(0, 5), default=0.2)
    band_hz: tuple[float, float] = key("slowest and fastest part", unit="1/s", range=(0, 20), default=(0.03, 0.4))


def expose(settings: Settings, linear: NDArray[np.float32], shot: Any) -> NDArray[np.float32]:
    drift = band_limited(generator(shot.seed, "exposure drift"), 1, settings.rms_stops, settings.band_hz)
    return linear * np.float32(2.0 ** drift(shot.frame.time_s)[0])
