"""A table of tracks drives the scene: SUMO's floating car data, or measured tracks in metres.

Rows are resampled to smooth curves: position by a monotone-time cubic through the samples, heading from the body's own
axles, so that neither SUMO's sideways jumps at lane changes nor a standing vehicle's undefined direction of motion
turns it on the spot.
"""

import csv
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from synth.checking import key
from synth.errors import InputError
from synth.traffic.fleet import BODIES, fastest_mps
from synth.traffic.rows import Row, number, require
from synth.traffic.stretches import gaps, jumps, longest_step_s, with_smooth_lane_changes
from synth.traffic.sumo import read_fcd, read_vehicle_classes

Array = NDArray[np.float64]

FARTHEST_M = 10_000.0
STANDS_M = 0.15  # a move shorter than this between samples says nothing about the heading
SMOOTH_M = 5.0  # headings are averaged over this distance: a car's length
GRID_M = 0.1
SAME_S = 1e-9  # a sample and a frame at the same time, but for rounding


@dataclass(frozen=True, kw_only=True)
class TrackTable:
    """A table of tracks instead of, or besides, simulated traffic."""

    file: str = key("the table, relative to the scene file: .csv, or SUMO's .xml")
    format: Literal["sumo", "metres"] = key(
        '"sumo": floating car data, the position of the front bumper\'s middle, angle clockwise from north; "metres": '
        "CSV with the columns id, time_s, x_m, y_m (center of the footprint) and optionally heading_deg "
        "(counter-clockwise from east), kind"
    )
    types: str | None = key(
        "SUMO's file with the vehicle types (`<vType id= vClass=>`), relative to the scene file: each gets the body of "
        "its vClass; without it the whole words of its name decide, and what they do not tell is said", default=None,
    )  # fmt: skip
    start_s: float = key("the table's time at the first frame", unit="s", range=(0, 1e7), default=0.0)
    bridge_s: float | None = key(
        "the longest time between two samples of a track that a curve may bridge; over longer ones the road user is "
        "absent. Without the key: 1.5 times the table's usual step, at least 0.5 s", unit="s", range=(0.001, 1e4),
        default=None,
    )  # fmt: skip
    jumps: Literal["refuse", "split"] = key(
        'a step that nobody could have driven: "refuse" the table, or "split" the track, which leaves the road user '
        "out between the two samples", default="refuse",
    )  # fmt: skip
    recentre: bool = key("move the middle of all tracks to the origin; required beyond 10 km, where flow loses pixels",
                         default=False)  # fmt: skip
    scale: float = key("the table's coordinates are multiplied by this first: 0.3048 for feet", range=(1e-4, 1e4),
                       default=1.0)  # fmt: skip
    turn_deg: float = key("turns the tracks counter-clockwise about the origin, after `recentre`", unit="degrees",
                          range=(-360, 360), default=0.0)  # fmt: skip
    shift_m: tuple[float, float] = key("moves them east and north, last of all", unit="m", range=(-1e7, 1e7),
                                       default=(0.0, 0.0))  # fmt: skip
    overlaps: Literal["refuse", "allow"] = key(
        '"allow": two road users of the table may touch, for measured ones that are shorter than their kinds',
        default="refuse",
    )


@dataclass(frozen=True)
class Stretch:
    """Samples in time that a curve joins, of the centre of a footprint."""

    times_s: Array  # [N]
    centres: Array  # [N, 2]
    headings: Array  # [N], unwrapped


@dataclass(frozen=True)
class Track:
    """One road user: absent before, between and after its stretches. `name` is its id in the table."""

    name: str
    kind: str
    stretches: tuple[Stretch, ...]

    def stretch(self, time_s: float) -> Stretch:
        """The last one that has begun; before all of them the first."""
        return next((s for s in reversed(self.stretches) if s.times_s[0] <= time_s + SAME_S), self.stretches[0])

    def here(self, time_s: float) -> bool:
        stretch = self.stretch(time_s)
        return bool(stretch.times_s[0] - SAME_S <= time_s <= stretch.times_s[-1] + SAME_S)


@dataclass(frozen=True)
class Tracks:
    """All of a table. `origin_m` is what was subtracted from its coordinates; `may_touch`: each other; `notes`: what
    of the table is not shown as it stands, in sentences."""

    tracks: tuple[Track, ...]
    origin_m: tuple[float, float]
    may_touch: bool = False
    notes: tuple[str, ...] = ()

    @property
    def kinds(self) -> tuple[str, ...]:
        return tuple(track.kind for track in self.tracks)

    def here(self, time_s: float) -> NDArray[np.bool_]:
        return np.array([track.here(time_s) for track in self.tracks], dtype=bool)

    def poses(self, time_s: float) -> tuple[Array, Array]:
        centres, headings = np.empty((len(self.tracks), 2)), np.empty(len(self.tracks))
        for m, track in enumerate(self.tracks):
            stretch = track.stretch(time_s)
            centres[m] = _cubic(stretch.times_s, stretch.centres, time_s)[0]
            headings[m] = _cubic(stretch.times_s, stretch.headings[:, None], time_s)[0][0]
        return centres, headings

    def heights(self, time_s: float) -> Array:  # noqa: ARG002 - on the ground at any time
        return np.zeros(len(self.tracks))

    def speeds(self, time_s: float) -> Array:
        here = self.here(time_s)
        stretches = (track.stretch(time_s) for track in self.tracks)
        speeds = [np.hypot(*_cubic(s.times_s, s.centres, time_s)[1]) for s in stretches]
        return np.where(here, np.array(speeds).reshape(-1), 0.0)


def read_tracks(table: TrackTable, folder: Path, duration_s: float, where: str = "tracks") -> Tracks:
    """Read a table: those who are there at some time of a clip of `duration_s`.

    Raises:
        InputError: the file cannot be read, holds no tracks, none during the clip, one that nobody could have driven,
            or lies too far from the origin.
    """
    path = _beside_the_scene(folder, table.file, f"{where}.file")
    rows, guesses = _read(table, folder, path, where)
    if not rows:
        raise InputError(f"{path}: holds no tracks.")
    tracks, notes = _tracks({name: sorted(of, key=lambda row: row.time_s) for name, of in rows.items()}, table, path)
    samples = [stretch for track in tracks for stretch in track.stretches]
    everywhere = np.concatenate([stretch.centres for stretch in samples])
    origin = np.round(0.5 * (everywhere.min(axis=0) + everywhere.max(axis=0)), 1) if table.recentre else np.zeros(2)
    farthest = float(np.abs(_placed(everywhere - origin, table)).max())
    if farthest > FARTHEST_M:
        raise InputError(
            f"{path}: a track lies {farthest / 1000:.0f} km from the origin; set {where}.recentre = true, which moves "
            "the middle of all tracks there, or shift_m (far from the origin flow loses whole pixels)."
        )
    first, last = min(s.times_s[0] for s in samples), max(s.times_s[-1] for s in samples)
    shown = [
        Track(t.name, t.kind, tuple(
            Stretch(s.times_s - table.start_s, _placed(s.centres - origin, table),
                    s.headings + math.radians(table.turn_deg)) for s in during))
        for t in tracks
        if (during := [s for s in t.stretches
                       if s.times_s[0] <= table.start_s + duration_s and s.times_s[-1] >= table.start_s])
    ]  # fmt: skip
    if not shown:
        raise InputError(
            f"{path}: nobody is there during the clip: the tracks run from {first:g} s to {last:g} s, the clip from "
            f"{table.start_s:g} s to {table.start_s + duration_s:g} s; set {where}.start_s."
        )
    return Tracks(tuple(shown), (float(origin[0]), float(origin[1])), table.overlaps == "allow", (*guesses, *notes))


def _placed(points: Array, table: TrackTable) -> Array:
    """Points [N, 2] turned and shifted as the table's keys say; bit for bit themselves without them."""
    if table.turn_deg:
        cos, sin = math.cos(math.radians(table.turn_deg)), math.sin(math.radians(table.turn_deg))
        points = points @ np.array([[cos, sin], [-sin, cos]])
    return points + table.shift_m


def _beside_the_scene(folder: Path, name: str, where: str) -> Path:
    if ".." in Path(name).parts or Path(name).is_absolute():
        raise InputError(f"{where}: {name!r} must lie in the scene's folder or below it.")
    return folder / name


def _read(table: TrackTable, folder: Path, path: Path, where: str) -> tuple[dict[str, list[Row]], tuple[str, ...]]:
    """Rows by id, and notes on what of them is a guess."""
    reading = path
    try:
        if table.format == "metres":
            if table.types is not None:
                raise InputError(f'{where}.types: is for format = "sumo"; here the column kind says what each is.')
            return _metres(path), ()
        classes = {}
        if table.types is not None:
            reading = _beside_the_scene(folder, table.types, f"{where}.types")
            classes = read_vehicle_classes(reading)
            reading = path
        return read_fcd(path, classes)
    except OSError as error:
        raise InputError(f"{reading}: cannot read the tracks: {error.strerror}.") from None
    except UnicodeDecodeError:
        raise InputError(f"{reading}: cannot read the tracks: it is not UTF-8 text.") from None
    except ElementTree.ParseError as error:
        raise InputError(f"{reading}: not valid XML: {error}.") from None


def _metres(path: Path) -> dict[str, list[Row]]:
    rows: dict[str, list[Row]] = {}
    with path.open(encoding="utf-8-sig", newline="") as stream:
        reader = csv.DictReader(stream)
        require(path, reader.fieldnames or [], ("id", "time_s", "x_m", "y_m"))
        for line, row in enumerate(reader, start=2):
            where = f"{path}: line {line}"
            kind = row.get("kind") or "saloon"
            if kind not in BODIES:
                raise InputError(f"{where}: kind {kind!r} must be one of {', '.join(BODIES)}.")
            heading = row.get("heading_deg") or ""
            angle = math.radians(number(heading, f"{where}: heading_deg")) if heading else math.nan
            time_s, x, y = (number(row[name], f"{where}: {name}") for name in ("time_s", "x_m", "y_m"))
            rows.setdefault(row["id"], []).append(Row(time_s, x, y, angle, kind))
    return rows


def _tracks(rows: dict[str, list[Row]], table: TrackTable, path: Path) -> tuple[list[Track], tuple[str, ...]]:
    """Tracks from rows in the order of time, and what of them is left out."""
    steps = np.concatenate([np.diff([row.time_s for row in of]) for of in rows.values()])
    longest_s = longest_step_s(steps) if table.bridge_s is None else table.bridge_s
    tracks, holes_s = [], []
    alone = sum(map(len, rows.values()))
    for name, of in rows.items():
        stretches = tuple(_stretches(name, of, longest_s, table, path))
        alone -= sum(len(stretch.times_s) for stretch in stretches)
        if stretches:
            tracks.append(Track(name, of[0].kind, stretches))
            holes_s += [after.times_s[0] - before.times_s[-1] for before, after in itertools.pairwise(stretches)]
    if not tracks:
        raise InputError(f"{path}: every track has one sample only; two or more are needed.")
    notes = []
    if holes_s:
        notes.append(
            f"{path}: gaps in tracks: {len(holes_s)}, of up to {max(holes_s):.3g} s, in which their road users are "
            "absent; tracks.bridge_s sets how long a gap a curve may bridge."
        )
    if alone:
        notes.append(f"{path}: rows that stand alone in time or place, and are left out: {alone}.")
    return tracks, tuple(notes)


def _stretches(name: str, rows: list[Row], longest_s: float, table: TrackTable, path: Path) -> Iterator[Stretch]:
    """The stretches of one road user; a sample that stands alone is left out."""
    times = np.array([row.time_s for row in rows])
    if (np.diff(times) <= 0).any():
        raise InputError(f"{path}: {name!r} is at two places at {times[int(np.diff(times).argmin())]:g} s.")
    given = np.array([row.heading for row in rows])
    centres = table.scale * np.array([(row.x, row.y) for row in rows])
    ahead = np.array([row.ahead_m for row in rows])
    if ahead.any():
        centres -= ahead[:, None] * np.stack([np.cos(given), np.sin(given)], axis=1)
    body = BODIES[rows[0].kind]
    for part in _parts(times, gaps(times, longest_s)):
        if table.format == "sumo":
            centres[part] = with_smooth_lane_changes(times[part], centres[part], given[part])
        wrong = jumps(times[part], centres[part], fastest_mps(rows[0].kind))
        if wrong and table.jumps == "refuse":
            start, speed = part.start + wrong[0].index, wrong[0].speed_mps
            raise InputError(
                f"{path}: {name!r} would have to move at {speed:.0f} m/s from {times[start]:g} s to "
                f"{times[start + 1]:g} s, which a {rows[0].kind} there could not; mend the table, or set tracks.jumps "
                '= "split", which leaves it out in between.'
            )
        for inner in _parts(times[part], np.array([jump.index for jump in wrong], dtype=np.int64)):
            t, c = times[part][inner], centres[part][inner]
            if len(t) > 1:
                headings = _headings(t, c, given[part][inner], max(body.wheelbase_m, 0.5))
                yield Stretch(t, c, headings)


def _parts(times: Array, last: NDArray[np.int64]) -> Iterator[slice]:
    """Slices of samples that end with those of index `last`."""
    edges = [0, *(last + 1).tolist(), len(times)]
    return (slice(a, b) for a, b in itertools.pairwise(edges))


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
