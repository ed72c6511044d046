"""The scene file: TOML checked against frozen dataclasses.

Every field below is a key of the file (see `synth/checking.py`). `read_scene` refuses an unknown key, a wrong type, a
value out of range and a missing key with the file, the key, and what would be allowed.
"""

import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from synth.checking import check, key
from synth.effects import choose
from synth.errors import InputError
from synth.export import FORMATS
from synth.truth import ALWAYS, PASSES

Arm = Literal["east", "north", "west", "south"]
Kind = Literal["hatchback", "saloon", "suv", "van"]
Route = Literal[
    "east-north", "east-west", "east-south",
    "north-east", "north-west", "north-south",
    "west-east", "west-north", "west-south",
    "south-east", "south-north", "south-west",
]  # fmt: skip
Interval = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Time:
    fps: float = key("", range=(0.1, 1000))
    frames: int = key("", range=(1, 100_000))


@dataclass(frozen=True, kw_only=True)
class Camera:
    width_px: int = key("", range=(16, 8192))
    height_px: int = key("", range=(16, 8192))
    hfov_deg: float = key("", range=(5, 150))


@dataclass(frozen=True, kw_only=True)
class Flight:
    """An arc at constant altitude and angular rate that looks at `centre_m`."""

    kind: Literal["arc"]
    centre_m: tuple[float, float, float] = key("", range=(-10_000, 10_000), default=(0.0, 0.0, 0.0))
    radius_m: float = key("", range=(0, 2000))
    altitude_m: float = key("", range=(1, 2000))
    start_deg: float = key("", range=(-3600, 3600))
    sweep_deg: float = key("", range=(-3600, 3600))


@dataclass(frozen=True, kw_only=True)
class Street:
    """A crossing of two streets with one lane each way and a parking strip on either side."""

    kind: Literal["crossroads"]
    arm_m: float = key("", range=(30, 1000), default=80.0)
    lane_width_m: float = key("", range=(2.5, 5), default=3.2)
    parking_width_m: float = key("", range=(2, 4), default=2.1)
    pavement_width_m: float = key("", range=(1.5, 10), default=3.2)
    corner_radius_m: float = key("", range=(2, 12), default=3.5)


@dataclass(frozen=True, kw_only=True)
class Block:
    """What stands on one of the four corners."""

    corner: Literal["north-east", "north-west", "south-west", "south-east"]
    kind: Literal["buildings", "park"]
    floors: tuple[int, int] = key("", range=(1, 40), default=(2, 4))


@dataclass(frozen=True, kw_only=True)
class Signal:
    """Green intervals in seconds from the first frame; outside them the lights are red."""

    east_west_green_s: tuple[Interval, ...]
    north_south_green_s: tuple[Interval, ...]


@dataclass(frozen=True, kw_only=True)
class Traffic:
    """Time step of the simulation and the parameters of the intelligent driver model."""

    step_s: float = key("", range=(0.001, 1), default=0.02)
    acceleration_mps2: float = key("", range=(0.1, 10), default=2.0)
    deceleration_mps2: float = key("", range=(0.1, 10), default=3.0)
    headway_s: float = key("", range=(0.1, 10), default=1.0)
    gap_m: float = key("", range=(0.1, 20), default=1.5)
    parked_share: float = key("", range=(0, 1), default=0.5)


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """One driven vehicle: where its front bumper is at time 0 (0 at the stop line, negative before it)."""

    route: Route
    position_m: float = key("", range=(-10_000, 10_000))
    speed_mps: float = key("", range=(0, 60))
    cruise_mps: float = key("", range=(0.5, 60), default=9.0)
    kind: Kind = "saloon"
    colour: tuple[float, float, float] | None = key("", range=(0, 1), default=None)


@dataclass(frozen=True, kw_only=True)
class Light:
    sun_azimuth_deg: float = key("", range=(-360, 360), default=220.0)
    sun_elevation_deg: float = key("", range=(5, 90), default=50.0)
    sun_angle_deg: float = key("", range=(0, 20), default=1.5)
    sun_strength: float = key("", range=(0, 100), default=3.5)
    sky_strength: float = key("", range=(0, 100), default=0.9)


@dataclass(frozen=True, kw_only=True)
class Render:
    samples: int = key("", range=(1, 65_536), default=16)
    denoise: bool = True


@dataclass(frozen=True, kw_only=True)
class Truth:
    """Which passes of ground truth are written: names of the registry in `synth/truth/`."""

    passes: tuple[str, ...] = key("names of passes", default=ALWAYS)
    cell_m: float = key("side of the ground cells of the pass `activity`", unit="metres", range=(0.1, 100), default=1.0)


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A whole scene file.

    `effects` holds the raw tables `[effects.NAME]`: the registry in `synth/effects/` checks each against the effect's
    own dataclass with `synth.checking.check`, so that an effect that no scene names is never imported.
    """

    name: str
    seed: int = key("", range=(0, 2**31 - 1), default=0)
    time: Time
    camera: Camera
    flight: Flight
    street: Street
    blocks: tuple[Block, ...] = ()
    signal: Signal | None = None
    traffic: Traffic = Traffic()
    vehicles: tuple[Vehicle, ...] = ()
    light: Light = Light()
    render: Render = Render()
    truth: Truth = Truth()
    exports: tuple[str, ...] = key("annotation formats to write besides", default=())
    effects: dict[str, Any] = field(default_factory=dict)


def read_scene(path: Path) -> Scene:
    """Read and check a scene file.

    Raises:
        InputError: the file cannot be read, is not TOML, or holds something the scene does not allow.
    """
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise InputError(f"{path}: cannot read the scene file: {reason}.") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML: {error}.") from None
    return parse_scene(table, str(path))


def parse_scene(table: dict[str, Any], source: str) -> Scene:
    """Check an already parsed scene file; `source` names it in messages."""
    scene: Scene = check(Scene, table, "", source)
    _check_across(scene, source)
    return scene


def _check_across(scene: Scene, source: str) -> None:
    """What one key alone cannot tell."""
    if not scene.name or not all(c.isalnum() or c in "-_." for c in scene.name):
        raise InputError(f"{source}: name: {scene.name!r} must be letters, digits, '-', '_' or '.'.")
    corners = [block.corner for block in scene.blocks]
    for corner in corners:
        if corners.count(corner) > 1:
            raise InputError(f"{source}: blocks: the corner {corner!r} is given twice; give each corner once.")
    for index, block in enumerate(scene.blocks):
        if block.floors[0] > block.floors[1]:
            raise InputError(f"{source}: blocks[{index}].floors: {list(block.floors)} must be [fewest, most].")
    choose(scene.effects, source)
    for name in scene.truth.passes:
        if name not in PASSES:
            raise InputError(f"{source}: truth.passes: unknown pass {name!r}; there are: {', '.join(PASSES)}.")
    for name in scene.exports:
        if name not in FORMATS:
            raise InputError(f"{source}: exports: unknown format {name!r}; there are: {', '.join(FORMATS)}.")
    if scene.signal is not None:
        for key in ("east_west_green_s", "north_south_green_s"):
            for start, end in getattr(scene.signal, key):
                if not start < end:
                    raise InputError(f"{source}: signal.{key}: [{start}, {end}] must be [start, later end].")
