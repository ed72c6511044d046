"""Curves of straight lines and circular arcs, parameterised by arc length, in float64."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Piece:
    """A line (curvature 0) or a circular arc (curvature 1/radius, positive to the left)."""

    start: tuple[float, float]
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
    def end(self) -> tuple[float, float]:
        x, y = self.points(np.array(self.length_m))
        return float(x), float(y)

    @property
    def end_heading(self) -> float:
        return self.heading + self.curvature * self.length_m


@dataclass(frozen=True)
class Path:
    """Pieces joined end to end. Before its start and after its end a path that starts and ends straight goes on."""

    pieces: tuple[Piece, ...]

    @property
    def length_m(self) -> float:
        return sum(piece.length_m for piece in self.pieces)

    def points(self, s: Array) -> Array:
        """Positions [..., 2] at arc lengths s [...]."""
        s = np.asarray(s, dtype=np.float64)
        starts = np.cumsum([0.0] + [piece.length_m for piece in self.pieces[:-1]])
        index = np.clip(np.searchsorted(starts, s, side="right") - 1, 0, len(self.pieces) - 1)
        result = np.empty((*s.shape, 2))
        for i, piece in enumerate(self.pieces):
            here = index == i
            result[here] = piece.points(s[here] - starts[i])
        return result

    def axle_pose(self, s: Array, wheelbase_m: float) -> tuple[Array, Array]:
        """Centre [..., 2] and heading [...] (radians) of a body whose two axles ride on the path.

        The heading points from the rear to the front axle: it is smooth where the curvature jumps, and it is defined
        at speed zero.
        """
        front = self.points(s + 0.5 * wheelbase_m)
        rear = self.points(s - 0.5 * wheelbase_m)
        axis = front - rear
        return 0.5 * (front + rear), np.arctan2(axis[..., 1], axis[..., 0])


def line(start: tuple[float, float], end: tuple[float, float]) -> Piece:
    """The straight piece from start to end."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    return Piece(start, float(np.arctan2(dy, dx)), 0.0, float(np.hypot(dx, dy)))
