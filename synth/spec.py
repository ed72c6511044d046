"""The scene file: TOML checked against frozen dataclasses.

Every field below is a key of the file (see `synth/checking.py`); `docs/scenes.md` is written from them. `read_scene`
refuses an unknown key, a wrong type, a value out of range and a missing key with the file, the key, and what would be
allowed.
"""

import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from synth.camera import Camera
from synth.checking import check, key
from synth.city.blocks import BLOCKS
from synth.effects import choose
from synth.errors import InputError
from synth.export import FORMATS
from synth.flight import FLIGHTS, Flight
from synth.streets import STREETS, UNLIT, Street
from synth.streets.ground import CORNERS
from synth.traffic.fleet import BODIES
from synth.traffic.settings import Flow, Parking, Pedestrians, Signal, Traffic, Vehicle
from synth.traffic.tracks import TrackTable
from synth.truth import ALWAYS, PASSES

__all__ = ["Camera", "Flow", "Parking", "Pedestrians", "Scene", "Signal", "Traffic", "Vehicle", "read_scene"]


@dataclass(frozen=True, kw_only=True)
class Time:
    """The clip."""

    fps: float = key("frames per second", unit="1/s", range=(0.1, 1000))
    frames: int = key("number of frames; the first is at time 0", range=(1, 100_000))


@dataclass(frozen=True, kw_only=True)
class Block:
    """What stands in a corner of the scene, one table for each; a corner without a block is lawn."""

    corner: Literal["north-east", "north-west", "south-west", "south-east"] = key("which corner, seen from the origin")
    kind: str = key("what stands there: " + ", ".join(f"`{name}`" for name in BLOCKS))
    floors: tuple[int, int] = key("[fewest, most] floors of its buildings", range=(1, 40), default=(2, 4))


@dataclass(frozen=True, kw_only=True)
class Greenery:
    """Trees along the streets."""

    street_trees: float = key("share of the places along the curbs that have a tree", range=(0, 1), default=0.7)


@dataclass(frozen=True, kw_only=True)
class Asset:
    """A model of your own for one kind of road user: it is turned, and scaled evenly until it fits the kind's box (a
    person with outstretched arms comes out small); its paint is kept, its surfaces are taken as opaque. Blender's
    importers read it."""

    kind: str = key("which kind it stands for: " + ", ".join(f"`{name}`" for name in BODIES))
    file: str = key("glTF, GLB, FBX or OBJ, relative to the scene file")
    yaw_deg: float = key("turns it so that it looks along +x", unit="degrees", range=(-360, 360), default=0.0)


@dataclass(frozen=True, kw_only=True)
class Light:
    """Sun and sky."""

    sun_azimuth_deg: float = key("direction the sun stands in, counter-clockwise from east", unit="degrees",
                                 range=(-360, 360), default=220.0)  # fmt: skip
    sun_elevation_deg: float = key("height of the sun above the horizon", unit="degrees", range=(5, 90), default=50.0)
    sun_angle_deg: float = key("apparent diameter: greater is softer shadows", unit="degrees", range=(0, 20),
                               default=1.5)  # fmt: skip
    sun_strength: float = key("brightness of the sun", unit="W/m²", range=(0, 100), default=3.5)
    sun_colour: tuple[float, float, float] = key("its color, linear RGB", range=(0, 1), default=(1.0, 0.95, 0.86))
    sky_strength: float = key("brightness of the sky", range=(0, 100), default=0.9)
    sky_colour: tuple[float, float, float] = key("color of the sky overhead, linear RGB", range=(0, 1),
                                                 default=(0.22, 0.38, 0.68))  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Render:
    """What a picture costs."""

    samples: int = key("samples of the picture; the ground truth always takes one, at the pixel's center",
                       unit="per pixel", range=(1, 65_536), default=16)  # fmt: skip
    denoise: bool = key("OpenImageDenoise on every frame", default=True)


@dataclass(frozen=True, kw_only=True)
class Truth:
    """Ground truth."""

    passes: tuple[str, ...] = key("which passes are written for every frame", default=ALWAYS)
    cell_m: float = key("side of the ground cells of the pass `activity`", unit="meters", range=(0.1, 100), default=1.0)


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A scene file. The world is right-handed with z up, in meters, its origin in the middle of the street; east is
    +x, north is +y. Angles of directions run counter-clockwise from east. Traffic keeps to the right."""

    name: str = key("the scene's name: letters, digits, `-` `_` `.`")
    seed: int = key("of everything random: buildings, trees, parked cars, paints, sampling noise",
                    range=(0, 2**31 - 1), default=0)  # fmt: skip
    time: Time = key("")
    camera: Camera = key("")
    flight: Flight = key("", kinds=FLIGHTS)
    second_flight: Flight | None = key(
        "A second drone films the same traffic at the same times, into the folder `second/` of the capture: a capture "
        "of its own, of true poses, all its frames held out. `aa4d eval` scores them: views that training never had.",
        kinds=FLIGHTS,
        default=None,
    )
    street: Street = key("", kinds=STREETS)
    blocks: tuple[Block, ...] = key("", default=())
    greenery: Greenery = key("", default=Greenery())
    signal: Signal | None = key("", default=None)
    traffic: Traffic = key("", default=Traffic())
    vehicles: tuple[Vehicle, ...] = key("", default=())
    flows: tuple[Flow, ...] = key("", default=())
    parking: Parking = key("", default=Parking())
    pedestrians: Pedestrians = key("", default=Pedestrians())
    tracks: TrackTable | None = key("", default=None)
    assets: tuple[Asset, ...] = key("", default=())
    light: Light = key("", default=Light())
    render: Render = key("", default=Render())
    truth: Truth = key("", default=Truth())
    exports: tuple[str, ...] = key("annotation formats to write besides: `tum`, `mot`, `coco`", default=())
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
    except (ValueError, RecursionError) as error:  # no TOML, or numbers or nesting without end
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
    for name, flight in (("flight", scene.flight), ("second_flight", scene.second_flight)):
        if flight is not None and (problem := flight.problem()):
            raise InputError(f"{source}: {name}.{problem}.")
    corners = [block.corner for block in scene.blocks]
    for index, block in enumerate(scene.blocks):
        if corners.count(block.corner) > 1:
            raise InputError(f"{source}: blocks: the corner {block.corner!r} is given twice; give each corner once.")
        if block.floors[0] > block.floors[1]:
            raise InputError(f"{source}: blocks[{index}].floors: {list(block.floors)} must be [fewest, most].")
        if block.kind not in BLOCKS:
            raise InputError(f"{source}: blocks[{index}].kind: {block.kind!r} must be one of {', '.join(BLOCKS)}.")
    assert set(corners) <= set(CORNERS)
    for index, asset in enumerate(scene.assets):
        if asset.kind not in BODIES:
            raise InputError(f"{source}: assets[{index}].kind: {asset.kind!r} must be one of {', '.join(BODIES)}.")
    if scene.signal is not None:
        if scene.street.kind in UNLIT:
            raise InputError(f"{source}: signal: a {scene.street.kind} has no traffic lights; leave the table out.")
        for name in ("east_west_green_s", "north_south_green_s"):
            for start, end in getattr(scene.signal, name):
                if not start < end:
                    raise InputError(f"{source}: signal.{name}: [{start}, {end}] must be [start, later end].")
    choose(scene.effects, source)
    for where, names in (("truth.passes", scene.truth.passes), ("exports", scene.exports)):
        for name in names:
            if names.count(name) > 1:
                raise InputError(f"{source}: {where}: {name!r} is given twice; give each once.")
    for name in scene.truth.passes:
        if name not in PASSES:
            raise InputError(f"{source}: truth.passes: unknown pass {name!r}; there are: {', '.join(PASSES)}.")
    for name in scene.exports:
        if name not in FORMATS:
            raise InputError(f"{source}: exports: unknown format {name!r}; there are: {', '.join(FORMATS)}.")
