"""What a finder of movers hands to training: a trajectory for each mover, and which pixels show it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aa4d.motion.spline import design

Array = NDArray[np.float64]

ALWAYS = (-2.0, -1.0, 2.0, 3.0)  # a mover that is there over the whole clip


@dataclass(frozen=True)
class Tracks:
    """G movers, each a rigid body that moves over the ground and turns about `up`; world metres."""

    names: tuple[str, ...]  # [G]
    control: Array  # [G, C, 4] control points (aa4d/motion/spline.py): x, y, z in metres, heading in radians
    # [G, 4] times in t: a mover appears over the first two, is there between the second and the third, and vanishes
    # over the last two. Times outside of [0, 1] say that the clip shows neither.
    shown: Array
    up: Array  # [3] unit
    # [V, H, W] of the training frames in order: 0, or the number of the mover, from 1, that a pixel shows. Not every
    # pixel of a mover needs to be in it, but what is in it is on the mover or on its rim.
    labels: NDArray[np.uint16]
    moving: NDArray[np.bool_]  # [V, H, W] every pixel that may show a mover, tracked or not; contains labels > 0

    def __len__(self) -> int:
        return len(self.names)

    def poses(self, t: Array) -> Array:
        """[G, S, 4]: x, y, z, heading of every mover at times t [S]."""
        return np.einsum("sc,gcd->gsd", design(t, self.control.shape[1]), self.control)

    def presence(self, t: Array) -> Array:
        """[G, S] in [0, 1]: how much of each mover is shown at times t [S]."""
        return np.stack([trapezoid(shown, np.asarray(t, np.float64)) for shown in self.shown])


def trapezoid(shown: Array, t: Array) -> Array:
    """0 before shown[0], 1 from shown[1] to shown[2], 0 after shown[3]; linear between."""
    appear, there, until, vanish = shown
    rising = np.clip((t - appear) / max(there - appear, 1e-9), 0, 1)
    falling = np.clip((vanish - t) / max(vanish - until, 1e-9), 0, 1)
    return np.asarray(np.minimum(rising, falling), np.float64)
