"""Keys that several flights share."""

from typing import Any

from synth.checking import REQUIRED, key

WORLD_M = 10_000.0
WHY_LOCAL = "coordinates are local: flow loses whole pixels far from the origin, so give them relative to the scene"


def centre() -> Any:
    return key("what the camera looks at, and flies around", unit="m", range=(-WORLD_M, WORLD_M),
               default=(0.0, 0.0, 0.0), why=WHY_LOCAL)  # fmt: skip


def altitude(meaning: str = "height above the ground (z of the camera)") -> Any:
    return key(meaning, unit="m", range=(1, 2000))


def radius(meaning: str) -> Any:
    return key(meaning, unit="m", range=(0, 2000))


def angle(meaning: str, default: Any = REQUIRED) -> Any:
    return key(meaning, unit="degrees", range=(-3600, 3600), default=default)


def place(meaning: str, default: Any = REQUIRED) -> Any:
    return key(meaning, unit="m", range=(-WORLD_M, WORLD_M), default=default, why=WHY_LOCAL)


def pitch(default: Any = REQUIRED) -> Any:
    return key("0 at the horizon, -90 straight down", unit="degrees", range=(-120, 20), default=default)
