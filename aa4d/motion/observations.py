"""What a finder of movers looks at: the training frames, and what a static model shows in their place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Observations:
    """V training frames in presentation order; world units are metres where the capture knows them."""

    images: NDArray[np.uint8]  # [V, H, W, 3] sRGB
    static_color: NDArray[np.float32]  # [V, H, W, 3] in [0, 1]
    static_depth_m: NDArray[np.float32]  # [V, H, W] depth_z in world units, 0 where there is nothing
    viewmat: Array  # [V, 4, 4] world to camera
    K: Array  # [3, 3] pixels
    t: Array  # [V] in [0, 1]
    rank: NDArray[np.int64]  # [V] place in the whole clip; held-out frames leave gaps
    frames: int  # of the whole clip
    fps: float

    def __len__(self) -> int:
        return len(self.images)

    @property
    def pixel(self) -> float:
        """World units that a pixel covers at the scene's median depth; 0 where no depth is known."""
        seen = self.static_depth_m[self.static_depth_m > 0]
        return float(np.median(seen)) / float(self.K[0, 0]) if len(seen) else 0.0
