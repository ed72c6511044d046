"""What moves while the shutter is open is smeared: objects and the camera along their exact paths."""

import dataclasses
from dataclasses import dataclass

from synth.checking import key
from synth.errors import InputError
from synth.shutter import Shutter

STAGE = "shutter"
COST = "the picture's rays are traced through moving geometry; more with more steps"
TRUTH = "none: depth, ids and flow stay those of the middle of the exposure"


@dataclass(frozen=True, kw_only=True)
class Settings:
    exposure_s: float = key(
        "how long each row is exposed; 0 is a sharp picture", unit="seconds", range=(0, 10), default=0.008
    )
    steps: int = key("motion is cut into 2^steps straight pieces", range=(1, 7), default=1)


def shut(settings: Settings, shutter: Shutter, fps: float) -> Shutter:
    """Raises InputError where the exposure is longer than a frame lasts."""
    if settings.exposure_s * fps > 1 + 1e-9:
        raise InputError(
            f"effects.motion_blur.exposure_s: {settings.exposure_s} is longer than a frame at {fps:g} frames per "
            f"second; at most {1 / fps:g}."
        )
    return dataclasses.replace(shutter, exposure_s=settings.exposure_s, steps=max(shutter.steps, settings.steps))
