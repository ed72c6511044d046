"""When each row of a picture is exposed."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Shutter:
    """A row is exposed for `exposure_s`; the middle of its exposure runs from half a readout before the frame's instant
    (top row) to half a readout after it (bottom row). The frame's pose and truth belong to that instant."""

    exposure_s: float = 0.0
    readout_s: float = 0.0
    steps: int = 1  # straight pieces that motion is cut into, as a power of two

    @property
    def instant(self) -> bool:
        """Nothing moves while it is open: there is nothing to simulate."""
        return self.exposure_s + self.readout_s == 0

    def span_s(self, time_s: float) -> tuple[float, ...]:
        """A frame's instant, and when its shutter opens and closes."""
        half = 0.5 * (self.exposure_s + self.readout_s)
        return (time_s,) if self.instant else (time_s - half, time_s, time_s + half)

    def row_offsets_s(self, height: int) -> NDArray[np.float64]:
        """Middle of the exposure of each row [H], relative to the frame's instant."""
        return self.readout_s * ((np.arange(height) + 0.5) / height - 0.5)
