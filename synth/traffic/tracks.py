"""A table of tracks drives the scene: SUMO's floating car data, or measured tracks in metres.

Rows are resampled to smooth curves: position by a monotone-time cubic through the samples, heading from the body's own
axles, so that neither SUMO's sideways jumps at lane changes nor a standing vehicle's undefined direction of motion
turns it on the spot.
"""

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from synth.checking import key
from synth.errors import InputError
from synth.traffic.fleet import BODIES

Array = NDArray[np.float64]

FARTHEST_M = 10_000.0
STANDS_M = 0.15  # a move shorter than this between samples says nothing about the heading
SMOOTH_M = 5.0  # headings are averaged over this distance: a car's length
GRID_M = 0.1


@dataclass(frozen=True, kw_only=True)
class TrackTable:
    """A table of tracks instead of, or besides, simulated traffic."""

    file: str = key("the table, relative to the scene file: .csv, or SUMO's .xml")
    format: Literal["sumo", "metres"] = key(
        '"sumo": floating car data, the position of the front bumper\'s middle, angle clockwise from north; "metres": '
        "CSV with the columns id, time_s, x_m, y_m (centre of the footprint) and optionally heading_deg "
        "(counter-clockwise from east), kind"
    )
    start_s: float = key("the table's time at the first frame", unit="s", range=(0, 1e7), default=0.0)
    recentre: bool = key("move the middle of all tracks to the origin; required beyond 10 km, where flow loses pixels",
                         default=False)  # fmt: skip
    overlaps: Literal["refuse", "allow"] = key(
        '"allow": two road users of the table may touch, for measured ones that are shorter than their kinds',
        default="refuse",
    )


@dataclass(frozen=True)
class _Row:
    time_s: float
    x: float
    y: float
    heading: float  # radians, counter-clockwise from east; NaN: unknown
    kind: str


@dataclass(frozen=True)
class Track:
    """One road user: samples in time, of the centre of its footprint. `name` is its id in the table."""

    name: str
    kind: str
    times_s: Array  # [N]
    centres: Array  # [N, 2]
    headings: Array  # [N], unwrapped


@dataclass(frozen=True)
class Tracks:
    """All of a table. `origin_m` is what was subtracted from its coordinates; `may_touch`: each other."""

    tracks: tuple[Track, ...]
    origin_m: tuple[float, float]
    may_touch: bool = False

    @property
    def kinds(self) -> tuple[str, ...]:
        return tuple(track.kind for track in self.tracks)

    def here(self, time_s: float) -> NDArray[np.bool_]:
        return np.array([t.times_s[0] <= time_s <= t.times_s[-1] for t in self.tracks], dtype=bool)

    def poses(self, time_s: float) -> tuple[Array, Array]:
        centres, headings = np.empty((len(self.tracks), 2)), np.empty(len(self.tracks))
        for m, track in enumerate(self.tracks):
            centres[m] = _cubic(track.times_s, track.centres, time_s)[0]
            headings[m] = _cubic(track.times_s, track.headings[:, None], time_s)[0][0]
        return centres, headings

    def heights(self, time_s: float) -> Array:  # noqa: ARG002 - on the ground at any time
        return np.zeros(len(self.tracks))

    def speeds(self, time_s: float) -> Array:
        here = self.here(time_s)
        speeds = [np.hypot(*_cubic(t.times_s, t.centres, time_s)[1]) for t in self.tracks]
        return np.where(here, np.array(speeds).reshape(-1), 0.0)


def read_tracks(table: TrackTable, folder: Path, duration_s: float, where: str = "tracks") -> Tracks:
    """Read a table: those who are there at some time of a clip of `duration_s`.

    Raises:
        InputError: the file cannot be read, holds no tracks, none during the clip, or lies too far from the origin.
    """
    path = folder / table.file
    if ".." in Path(table.file).parts or Path(table.file).is_absolute():
        raise InputError(f"{where}.file: {table.file!r} must lie in the scene's folder or below it.")
    try:
        rows = _sumo(path) if table.format == "sumo" else _metres(path)
    except OSError as error:
        raise InputError(f"{path}: cannot read the tracks: {error.strerror}.") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: cannot read the tracks: it is not UTF-8 text.") from None
    except ElementTree.ParseError as error:
        raise InputError(f"{path}: not valid XML: {error}.") from None
    if not rows:
        raise InputError(f"{path}: holds no tracks.")
    tracks = {name: _track(name, samples, path) for name, samples in rows.items() if len(samples) > 1}
    if not tracks:
        raise InputError(f"{path}: every track has one sample only; two or more are needed.")
    everywhere = np.concatenate([track.centres for track in tracks.values()])
    origin = np.round(0.5 * (everywhere.min(axis=0) + everywhere.max(axis=0)), 1) if table.recentre else np.zeros(2)
    farthest = float(np.abs(everywhere - origin).max())
    if farthest > FARTHEST_M:
        raise InputError(
            f"{path}: a track lies {farthest / 1000:.0f} km from the origin; set {where}.recentre = true, which moves "
            "the middle of all tracks there (far from the origin flow loses whole pixels)."
        )
    first, last = (f(track.times_s[end] for track in tracks.values()) for f, end in ((min, 0), (max, -1)))
    shown = [
        t for t in tracks.values() if t.times_s[0] <= table.start_s + duration_s and t.times_s[-1] >= table.start_s
    ]
    if not shown:
        raise InputError(
            f"{path}: nobody is there during the clip: the tracks run from {first:g} s to {last:g} s, the clip from "
            f"{table.start_s:g} s to {table.start_s + duration_s:g} s; set {where}.start_s."
        )
    moved = [Track(t.name, t.kind, t.times_s - table.start_s, t.centres - origin, t.headings) for t in shown]
    return Tracks(tuple(moved), (float(origin[0]), float(origin[1])), may_touch=table.overlaps == "allow")


def _sumo(path: Path) -> dict[str, list[_Row]]:
    rows: dict[str, list[_Row]] = {}

    def add(name: str, time: str, x: str, y: str, angle: str, type_name: str, where: str) -> None:
        kind = _sumo_kind(type_name)
        heading = math.radians(90.0 - _number(angle, f"{path}: {where}: angle"))
        half = 0.5 * BODIES[kind].length_m if kind != "pedestrian" else 0.0
        px, py = _number(x, f"{path}: {where}: x"), _number(y, f"{path}: {where}: y")
        row = _Row(_number(time, f"{path}: {where}: time"), px - half * math.cos(heading),
                   py - half * math.sin(heading), heading, kind)  # fmt: skip
        rows.setdefault(name, []).append(row)

    if path.suffix.lower() == ".xml":
        time = "0"
        for event, element in ElementTree.iterparse(path, events=("start", "end")):
            if event == "start" and element.tag == "timestep":
                time = element.get("time", "0")
            elif event == "end" and element.tag in ("vehicle", "person"):
                get = element.get
                kind = get("type", "") if element.tag == "vehicle" else "pedestrian"
                add(get("id", ""), time, get("x", ""), get("y", ""), get("angle", ""), kind, f"time {time}")
                element.clear()
        return rows
    with path.open(encoding="utf-8-sig", newline="") as stream:
        sample = stream.readline()
        stream.seek(0)
        reader = csv.DictReader(stream, delimiter=";" if ";" in sample else ",")
        columns = reader.fieldnames or []
        needed = ("timestep_time", "vehicle_id", "vehicle_x", "vehicle_y", "vehicle_angle")
        _require(path, columns, needed)
        for number, row in enumerate(reader, start=2):
            if row["vehicle_id"]:
                add(row["vehicle_id"], row["timestep_time"], row["vehicle_x"], row["vehicle_y"], row["vehicle_angle"],
                    row.get("vehicle_type") or "", f"line {number}")  # fmt: skip
    return rows


def _metres(path: Path) -> dict[str, list[_Row]]:
    rows: dict[str, list[_Row]] = {}
    with path.open(encoding="utf-8-sig", newline="") as stream:
        reader = csv.DictReader(stream)
        _require(path, reader.fieldnames or [], ("id", "time_s", "x_m", "y_m"))
        for number, row in enumerate(reader, start=2):
            where = f"{path}: line {number}"
            kind = row.get("kind") or "saloon"
            if kind not in BODIES:
                raise InputError(f"{where}: kind {kind!r} must be one of {', '.join(BODIES)}.")
            heading = row.get("heading_deg") or ""
            angle = math.radians(_number(heading, f"{where}: heading_deg")) if heading else math.nan
            time_s, x, y = (_number(row[name], f"{where}: {name}") for name in ("time_s", "x_m", "y_m"))
            rows.setdefault(row["id"], []).append(_Row(time_s, x, y, angle, kind))
    return rows


def _require(path: Path, columns: Sequence[str], needed: tuple[str, ...]) -> None:
    missing = [name for name in needed if name not in columns]
    if missing:
        raise InputError(f"{path}: the columns {', '.join(missing)} are missing; needed are {', '.join(needed)}.")


def _number(text: str | None, where: str) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{where}: {text!r} must be a finite number.")
    return value


def _sumo_kind(type_name: str) -> str:
    """The body for a SUMO vehicle type: by its name or class."""
    words = {"bus": "bus", "coach": "bus", "truck": "truck", "trailer": "truck", "delivery": "van", "van": "van",
             "bicycle": "cyclist", "bike": "cyclist", "pedestrian": "pedestrian", "ped": "pedestrian", "suv": "suv",
             "hatchback": "hatchback"}  # fmt: skip
    return next((kind for word, kind in words.items() if word in type_name.lower()), "saloon")


def _track(name: str, rows: list[_Row], path: Path) -> Track:
    rows = sorted(rows, key=lambda row: row.time_s)
    times = np.array([row.time_s for row in rows])
    if np.diff(times).min() <= 0:
        raise InputError(f"{path}: {name!r} is at two places at {times[int(np.diff(times).argmin())]:g} s.")
    centres = np.array([(row.x, row.y) for row in rows])
    body = BODIES[rows[0].kind]
    given = np.array([row.heading for row in rows])
    return Track(name, rows[0].kind, times, centres, _headings(times, centres, given, max(body.wheelbase_m, 0.5)))


def _headings(times: Array, centres: Array, given: Array, wheelbase_m: float) -> Array:
    """Unwrapped headings [N]: the direction from where the rear axle was to where the front axle will be, along the
    track itself; a vehicle that stands keeps its heading. Given headings stand in where it never moves."""
    travelled = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(centres, axis=0).T))])
    if travelled[-1] < STANDS_M:
        return np.full(len(times), given[0] if np.isfinite(given[0]) else 0.0)
    # Arc length must increase for the look-up: standing samples are left out.
    moves = np.concatenate([[True], np.diff(travelled) > 1e-6])
    s, points = travelled[moves], centres[moves]

    def at(along: Array) -> Array:
        inside = np.stack([np.interp(along, s, points[:, axis]) for axis in range(2)], axis=-1)
        first, last = _unit(points, s, 0), _unit(points, s, -1)
        inside += np.minimum(along - s[0], 0)[:, None] * first + np.maximum(along - s[-1], 0)[:, None] * last
        return inside

    # A function of place and not of time: who stands keeps its heading, wherever in a bend it stopped.
    grid = np.arange(s[0] - SMOOTH_M, s[-1] + SMOOTH_M + GRID_M, GRID_M)
    reach = max(0.5 * wheelbase_m, STANDS_M)
    axis = at(grid + reach) - at(grid - reach)
    headings = np.unwrap(np.arctan2(axis[:, 1], axis[:, 0]))
    width = round(SMOOTH_M / GRID_M) | 1
    padded = np.pad(headings, width // 2, mode="edge")
    return np.interp(travelled, grid, np.convolve(padded, np.ones(width) / width, mode="valid"))


def _unit(points: Array, s: Array, end: int) -> Array:
    """The direction of travel at the start (0) or the end (-1), over a stretch that is not noise."""
    far = int(np.searchsorted(s, s[0] + 1.0)) if end == 0 else int(np.searchsorted(s, s[-1] - 1.0)) - 1
    far = min(max(far, 0 if end else 1), len(points) - 1 if end == 0 else len(points) - 2)
    direction = (points[far] - points[0]) if end == 0 else (points[-1] - points[far])
    length = float(np.hypot(*direction))
    return direction / length if length > 0 else np.array([1.0, 0.0])


def _cubic(times: Array, values: Array, time_s: float) -> tuple[Array, Array]:
    """Value [D] and derivative [D] of a cubic Hermite curve through samples [N, D]; its slopes are limited so that it
    never overshoots (Fritsch, Carlson 1980): what stands between two samples stands."""
    t = min(max(time_s, float(times[0])), float(times[-1]))
    i = int(np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2))
    slopes = np.stack([_slope(times, values, i), _slope(times, values, i + 1)])
    h = times[i + 1] - times[i]
    u = (t - times[i]) / h
    a, b = values[i], values[i + 1]
    value = a + (b - a) * u * u * (3 - 2 * u) + h * (slopes[0] * u * (1 - u) ** 2 - slopes[1] * u * u * (1 - u))
    rate = (b - a) / h * 6 * u * (1 - u) + slopes[0] * (1 - u) * (1 - 3 * u) + slopes[1] * u * (3 * u - 2)
    return value, rate


def _slope(times: Array, values: Array, i: int) -> Array:
    """Slope [D] at sample i: the harmonic mean of those beside it, 0 where they differ in sign; one at the ends."""
    secants = np.diff(values[max(i - 1, 0) : i + 2], axis=0) / np.diff(times[max(i - 1, 0) : i + 2])[:, None]
    if len(secants) == 1:
        return secants[0]
    left, right = secants
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(left * right > 0, 2 * left * right / (left + right), 0.0)
