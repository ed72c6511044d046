"""The rows of a picture are read one after the other, from the top: each is a view from its own pose.

The capture says the pose of every row (`rows` in docs/formats.md).
"""

import dataclasses
from dataclasses import dataclass

from synth.checking import key
from synth.errors import InputError
from synth.shutter import Shutter

STAGE = "shutter"
COST = "as motion blur, with which it shares its rays"
TRUTH = "poses of every row are written; depth, ids and flow stay those of the frame's instant, the middle row's"


@dataclass(frozen=True, kw_only=True)
class Settings:
    readout_s: float = key(
        "from the first row to the last; 0 reads all at once", unit="seconds", range=(0, 10), default=0.01
    )
    steps: int = key("motion is cut into 2^steps straight pieces", range=(1, 7), default=2)


def shut(settings: Settings, shutter: Shutter, fps: float) -> Shutter:
    """Raises InputError where the readout takes longer than a frame lasts."""
    if settings.readout_s * fps > 1 + 1e-9:
        raise InputError(
            f"effects.rolling_shutter.readout_s: {settings.readout_s} is longer than a frame at {fps:g} frames per "
            f"second; at most {1 / fps:g}."
        )
    return dataclasses.replace(shutter, readout_s=settings.readout_s, steps=max(shutter.steps, settings.steps))
