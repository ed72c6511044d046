"""Curves of straight lines and circular arcs, parameterised by arc length, in float64."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Point = tuple[float, float]

SHARP_M = 1e-6  # corners rounded less than this stay corners


@dataclass(frozen=True)
class Piece:
    """A line (curvature 0) or a circular arc (curvature 1/radius, positive to the left)."""

    start: Point
    heading: float  # radians, counter-clockwise from east
    curvature: float
    length_m: float

    def points(self, s: Array) -> Array:
        """Positions [..., 2] at arc lengths s [...]; beyond its ends a line goes on."""
        # The chord of an arc of length s turns by half the arc's turn and is shortened by sinc.
        half_turn = 0.5 * self.curvature * s
        chord = s * np.sinc(half_turn / np.pi)
        angle = self.heading + half_turn
        return np.stack([self.start[0] + chord * np.cos(angle), self.start[1] + chord * np.sin(angle)], axis=-1)

    @property
    def end(self) -> Point:
        x, y = self.points(np.array(self.length_m))
        return float(x), float(y)

    @property
    def end_heading(self) -> float:
        return self.heading + self.curvature * self.length_m

    def inset(self, distance: float) -> "Piece":
        """The parallel curve `distance` to the left; an arc that would turn inside out becomes its centre."""
        nx, ny = -math.sin(self.heading), math.cos(self.heading)
        if self.curvature == 0.0:
            return Piece(
                (self.start[0] + distance * nx, self.start[1] + distance * ny), self.heading, 0.0, self.length_m
            )
        radius = 1 / self.curvature
        moved = radius - distance
        if moved * radius <= 0:
            moved = math.copysign(1e-3, radius)
        shift = radius - moved
        start = (self.start[0] + shift * nx, self.start[1] + shift * ny)
        return Piece(start, self.heading, 1 / moved, self.length_m * moved / radius)


@dataclass(frozen=True)
class Path:
    """Pieces joined end to end. Before its start and after its end a path that starts and ends straight goes on."""

    pieces: tuple[Piece, ...]

    @property
    def length_m(self) -> float:
        return sum(piece.length_m for piece in self.pieces)

    @cached_property
    def _starts(self) -> Array:
        return np.cumsum([0.0] + [piece.length_m for piece in self.pieces[:-1]])

    def points(self, s: Array) -> Array:
        """Positions [..., 2] at arc lengths s [...]."""
        return self.frames(s)[0]

    def frames(self, s: Array) -> tuple[Array, Array]:
        """Positions [..., 2] and headings [...] (radians) at arc lengths s [...]."""
        s = np.asarray(s, dtype=np.float64)
        index = np.clip(np.searchsorted(self._starts, s, side="right") - 1, 0, len(self.pieces) - 1)
        positions, headings = np.empty((*s.shape, 2)), np.empty(s.shape)
        for i in np.unique(index):
            piece, here = self.pieces[i], index == i
            along = s[here] - self._starts[i]
            positions[here] = piece.points(along)
            headings[here] = piece.heading + piece.curvature * along
        return positions, headings

    def beside(self, s: Array, left_m: Array) -> Array:
        """Positions [..., 2] that lie `left_m` to the left of the path at arc lengths s."""
        positions, headings = self.frames(s)
        return positions + np.asarray(left_m)[..., None] * np.stack([-np.sin(headings), np.cos(headings)], axis=-1)

    def axle_pose(self, s: Array, wheelbase_m: float, shift: "Shift | None" = None) -> tuple[Array, Array]:
        """Centre [..., 2] and heading [...] (radians) of a body whose two axles ride on the path.

        The heading points from the rear to the front axle: it is smooth where the curvature jumps, and it is defined
        at speed zero. `shift` moves both axles sideways.
        """
        s = np.asarray(s, dtype=np.float64)
        axles = np.stack([s + 0.5 * wheelbase_m, s - 0.5 * wheelbase_m])
        ends = self.points(axles) if shift is None else self.beside(axles, shift.left_m(axles))
        axis = ends[0] - ends[1]
        return 0.5 * (ends[0] + ends[1]), np.arctan2(axis[..., 1], axis[..., 0])

    def inset(self, distance: float) -> "Path":
        """The parallel path `distance` to the left, piece by piece."""
        return Path(tuple(piece.inset(distance) for piece in self.pieces))

    def outline(self, chord_deg: float = 11.25) -> list[Point]:
        """The corners of a polyline along the path: the ends of its pieces, and points on its arcs."""
        result: list[Point] = []
        for piece in self.pieces:
            turn = abs(piece.curvature * piece.length_m)
            count = max(1, math.ceil(math.degrees(turn) / chord_deg - 1e-9)) if piece.curvature else 1
            points = piece.points(np.linspace(0, piece.length_m, count + 1))
            result.extend((float(x), float(y)) for x, y in (points if not result else points[1:]))
        return result


@dataclass(frozen=True)
class Shift:
    """A move sideways along a path: from one distance to the left to another, over `length_m` from arc length
    `start_m` on. A quintic, so that the steering is continuous; a function of place and not of time, so that a vehicle
    that stands keeps its heading."""

    from_m: float
    to_m: float
    start_m: float
    length_m: float

    def left_m(self, s: Array | float) -> Array:
        u = np.clip((s - self.start_m) / self.length_m, 0.0, 1.0)
        return self.from_m + (self.to_m - self.from_m) * u**3 * (10 + u * (6 * u - 15))


def line(start: Point, end: Point) -> Piece:
    """The straight piece from start to end."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    return Piece((float(start[0]), float(start[1])), float(np.arctan2(dy, dx)), 0.0, float(np.hypot(dx, dy)))


def rounded(points: Sequence[Point], radii: Sequence[float] | float) -> Path:
    """Straight lines through points, with a tangent arc of the given radius at each inner one; 0 keeps the corner.

    A radius that does not fit between its neighbours' is made smaller.
    """
    count = len(points)
    wanted = [radii] * count if isinstance(radii, (int, float)) else list(radii)
    lengths = [math.dist(a, b) for a, b in itertools.pairwise(points)]
    pieces: list[Piece] = []
    at = (float(points[0][0]), float(points[0][1]))
    for i in range(1, count - 1):
        before, after = line(points[i - 1], points[i]).heading, line(points[i], points[i + 1]).heading
        turn = math.remainder(after - before, 2 * math.pi)
        if abs(turn) < 1e-12:
            continue
        room = 0.5 * min(lengths[i - 1] * (2 if i == 1 else 1), lengths[i] * (2 if i == count - 2 else 1))
        radius = min(wanted[i], room / math.tan(0.5 * abs(turn)))
        if radius < SHARP_M:
            pieces.append(line(at, points[i]))
            at = (float(points[i][0]), float(points[i][1]))
            continue
        reach = radius * math.tan(0.5 * abs(turn))
        first = (points[i][0] - reach * math.cos(before), points[i][1] - reach * math.sin(before))
        if math.dist(at, first) > 1e-9:
            pieces.append(line(at, first))
        arc = Piece(first, before, math.copysign(1 / radius, turn), radius * abs(turn))
        pieces.append(arc)
        at = arc.end
    if math.dist(at, points[-1]) > 1e-9:
        pieces.append(line(at, points[-1]))
    return Path(tuple(pieces))


def joints(path: Path) -> Array:
    """Gaps between successive pieces: [pieces - 1, 2] of metres and radians (wrapped). All zero for a sound path."""
    gaps = []
    for before, after in itertools.pairwise(path.pieces):
        turn = math.remainder(after.heading - before.end_heading, 2 * math.pi)
        gaps.append((math.dist(before.end, after.start), turn))
    return np.array(gaps).reshape(-1, 2)
