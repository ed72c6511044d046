"""The scene file: TOML checked against frozen dataclasses.

Every field below is a key of the file; `docs/scenes.md` lists them. `read_scene` refuses an unknown key, a wrong type,
a value out of range and a missing key with the file, the key, and what would be allowed.
"""

import dataclasses
import difflib
import math
import tomllib
import types
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from synth.errors import InputError

Arm = Literal["east", "north", "west", "south"]
Kind = Literal["hatchback", "saloon", "suv", "van"]
Route = Literal[
    "east-north", "east-west", "east-south",
    "north-east", "north-west", "north-south",
    "west-east", "west-north", "west-south",
    "south-east", "south-north", "south-west",
]  # fmt: skip
Interval = tuple[float, float]


def within(low: float, high: float, default: Any = dataclasses.MISSING) -> Any:
    """A field whose value (or each of its values) lies in [low, high]."""
    return field(default=default, metadata={"range": (low, high)})


@dataclass(frozen=True, kw_only=True)
class Time:
    fps: float = within(0.1, 1000)
    frames: int = within(1, 100_000)


@dataclass(frozen=True, kw_only=True)
class Camera:
    width_px: int = within(16, 8192)
    height_px: int = within(16, 8192)
    hfov_deg: float = within(5, 150)


@dataclass(frozen=True, kw_only=True)
class Flight:
    """An arc at constant altitude and angular rate that looks at `centre_m`."""

    kind: Literal["arc"]
    centre_m: tuple[float, float, float] = within(-10_000, 10_000, (0.0, 0.0, 0.0))
    radius_m: float = within(0, 2000)
    altitude_m: float = within(1, 2000)
    start_deg: float = within(-3600, 3600)
    sweep_deg: float = within(-3600, 3600)


@dataclass(frozen=True, kw_only=True)
class Street:
    """A crossing of two streets with one lane each way and a parking strip on either side."""

    kind: Literal["crossroads"]
    arm_m: float = within(30, 1000, 80.0)
    lane_width_m: float = within(2.5, 5, 3.2)
    parking_width_m: float = within(2, 4, 2.1)
    pavement_width_m: float = within(1.5, 10, 3.2)
    corner_radius_m: float = within(2, 12, 3.5)


@dataclass(frozen=True, kw_only=True)
class Block:
    """What stands on one of the four corners."""

    corner: Literal["north-east", "north-west", "south-west", "south-east"]
    kind: Literal["buildings", "park"]
    floors: tuple[int, int] = within(1, 40, (2, 4))


@dataclass(frozen=True, kw_only=True)
class Signal:
    """Green intervals in seconds from the first frame; outside them the lights are red."""

    east_west_green_s: tuple[Interval, ...]
    north_south_green_s: tuple[Interval, ...]


@dataclass(frozen=True, kw_only=True)
class Traffic:
    """Time step of the simulation and the parameters of the intelligent driver model."""

    step_s: float = within(0.001, 1, 0.02)
    acceleration_mps2: float = within(0.1, 10, 2.0)
    deceleration_mps2: float = within(0.1, 10, 3.0)
    headway_s: float = within(0.1, 10, 1.0)
    gap_m: float = within(0.1, 20, 1.5)
    parked_share: float = within(0, 1, 0.5)


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """One driven vehicle: where its front bumper is at time 0 (0 at the stop line, negative before it)."""

    route: Route
    position_m: float = within(-10_000, 10_000)
    speed_mps: float = within(0, 60)
    cruise_mps: float = within(0.5, 60, 9.0)
    kind: Kind = "saloon"
    colour: tuple[float, float, float] | None = within(0, 1, None)


@dataclass(frozen=True, kw_only=True)
class Light:
    sun_azimuth_deg: float = within(-360, 360, 220.0)
    sun_elevation_deg: float = within(5, 90, 50.0)
    sun_angle_deg: float = within(0, 20, 1.5)
    sun_strength: float = within(0, 100, 3.5)
    sky_strength: float = within(0, 100, 0.9)


@dataclass(frozen=True, kw_only=True)
class Render:
    samples: int = within(1, 65_536, 16)
    denoise: bool = True


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A whole scene file."""

    name: str
    seed: int = within(0, 2**31 - 1, 0)
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
    scene: Scene = _Checker(source).record(Scene, table, "")
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
    if scene.signal is not None:
        for key in ("east_west_green_s", "north_south_green_s"):
            for start, end in getattr(scene.signal, key):
                if not start < end:
                    raise InputError(f"{source}: signal.{key}: [{start}, {end}] must be [start, later end].")


@dataclass(frozen=True)
class _Checker:
    source: str

    def fail(self, key: str, message: str) -> InputError:
        return InputError(f"{self.source}: {key}: {message}.")

    def record(self, cls: type, table: Any, key: str) -> Any:
        """A table of the file as an instance of `cls`."""
        if not isinstance(table, dict):
            raise self.fail(key, f"must be a table of keys, not {_describe(table)}")
        fields = {f.name: f for f in dataclasses.fields(cls)}
        hints = get_type_hints(cls)
        prefix = f"{key}." if key else ""
        for name in table:
            if name not in fields:
                near = difflib.get_close_matches(name, fields, n=1, cutoff=0.5)
                hint = f"did you mean {near[0]!r}? " if near else ""
                raise self.fail(prefix + name, f"unknown key; {hint}allowed here: {', '.join(fields)}")
        values = {}
        for name, spec in fields.items():
            if name in table:
                values[name] = self.value(hints[name], table[name], prefix + name, spec.metadata.get("range"))
            elif spec.default is dataclasses.MISSING:
                raise self.fail(prefix + name, f"missing; it must be {_expected(hints[name], spec.metadata)}")
        return cls(**values)

    def value(self, kind: Any, value: Any, key: str, limits: tuple[float, float] | None) -> Any:
        """One value of the file as the type `kind`."""
        if get_origin(kind) in (Union, types.UnionType):
            kind = next(option for option in get_args(kind) if option is not types.NoneType)
        expected = _expected(kind, {"range": limits} if limits else {})
        if dataclasses.is_dataclass(kind):
            return self.record(kind, value, key)  # type: ignore[arg-type]
        if get_origin(kind) is tuple:
            return self.sequence(kind, value, key, limits)
        if get_origin(kind) is Literal:
            if value not in get_args(kind):
                near = difflib.get_close_matches(str(value), get_args(kind), n=1)
                hint = f", did you mean {near[0]!r}?" if near else ""
                raise self.fail(key, f"{_describe(value)} must be {expected}{hint}".removesuffix("."))
            return value
        accepted = (int, float) if kind is float else (kind,)
        if not isinstance(value, accepted) or (isinstance(value, bool) and kind is not bool):
            raise self.fail(key, f"{_describe(value)} must be {expected}")
        finite = not isinstance(value, float) or math.isfinite(value)
        if not finite or (limits and not limits[0] <= value <= limits[1]):
            raise self.fail(key, f"{value} is out of range, it must be {expected}")
        return float(value) if kind is float else value

    def sequence(self, kind: Any, value: Any, key: str, limits: tuple[float, float] | None) -> tuple[Any, ...]:
        items = get_args(kind)
        if not isinstance(value, list):
            raise self.fail(key, f"{_describe(value)} must be {_expected(kind, {})}")
        if items[-1] is Ellipsis:
            return tuple(self.value(items[0], item, f"{key}[{i}]", limits) for i, item in enumerate(value))
        if len(value) != len(items):
            raise self.fail(key, f"a list of {len(value)} must be {_expected(kind, {})}")
        return tuple(self.value(items[i], item, f"{key}[{i}]", limits) for i, item in enumerate(value))


def _describe(value: Any) -> str:
    names = {bool: "the boolean", str: "the text", int: "the number", float: "the number"}
    return f"{names[type(value)]} {value!r}" if type(value) in names else f"a {type(value).__name__}"


def _expected(kind: Any, metadata: Any) -> str:
    """What a key would accept, in words."""
    if get_origin(kind) in (Union, types.UnionType):
        kind = next(option for option in get_args(kind) if option is not types.NoneType)
    if dataclasses.is_dataclass(kind):
        return "a table of keys"
    if get_origin(kind) is Literal:
        return "one of " + ", ".join(repr(option) for option in get_args(kind))
    if get_origin(kind) is tuple:
        items = get_args(kind)
        count = "any number" if items[-1] is Ellipsis else str(len(items))
        what = (
            "lists" if get_origin(items[0]) is tuple else "tables" if dataclasses.is_dataclass(items[0]) else "numbers"
        )
        return f"a list of {count} {what}" if count != "any number" else f"a list of {what}"
    words = {int: "a whole number", float: "a number", str: "a text", bool: "true or false"}[kind]
    if metadata.get("range"):
        words += " from {:g} to {:g}".format(*metadata["range"])
    return words
