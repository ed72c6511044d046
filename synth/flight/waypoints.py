"""Waypoints: a smooth curve through places, at constant speed between them."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from synth.flight import keys
from synth.flight.arc import Place
from synth.flight.orientation import look_at, orientation, pose

Array = NDArray[np.float64]


def natural_spline(knots: Array, points: Array) -> Array:
    """Second derivatives [N, D] of the natural cubic spline (C2) through points [N, D] at increasing knots [N]."""
    count = len(knots)
    step = np.diff(knots)
    system, right = np.eye(count), np.zeros_like(points)
    for i in range(1, count - 1):
        system[i, i - 1 : i + 2] = step[i - 1], 2 * (step[i - 1] + step[i]), step[i]
        right[i] = 6 * ((points[i + 1] - points[i]) / step[i] - (points[i] - points[i - 1]) / step[i - 1])
    return np.linalg.solve(system, right)


@dataclass(frozen=True, kw_only=True)
class Waypoints:
    """A curve through places with continuous acceleration; the time between two of them is as their distance."""

    kind: Literal["waypoints"] = "waypoints"
    points_m: tuple[Place, ...] = keys.place("two places or more, successive ones at least a meter apart")
    target_m: Place | None = keys.place("what it looks at; without it the view follows the curve", None)
    yaw_deg: float | None = keys.angle(
        "with a target: the heading that is up at nadir, for curves that pass above it; default: a level horizon", None
    )
    pitch_deg: float = keys.pitch(-45.0)

    @cached_property
    def _spline(self) -> tuple[Array, Array, Array]:
        points = np.array(self.points_m)
        knots = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        knots /= knots[-1]
        return knots, points, natural_spline(knots, points)

    def _at(self, share: float) -> tuple[Array, Array]:
        """Position [3] and its derivative [3]; before the first and behind the last place a straight line."""
        knots, points, bend = self._spline
        u = min(max(share, 0.0), 1.0)
        i = int(np.clip(np.searchsorted(knots, u, side="right") - 1, 0, len(knots) - 2))
        h = knots[i + 1] - knots[i]
        a, b = (knots[i + 1] - u) / h, (u - knots[i]) / h
        position = a * points[i] + b * points[i + 1] + ((a**3 - a) * bend[i] + (b**3 - b) * bend[i + 1]) * h * h / 6
        slope = (points[i + 1] - points[i]) / h + ((1 - 3 * a * a) * bend[i] + (3 * b * b - 1) * bend[i + 1]) * h / 6
        return position + slope * (share - u), slope

    def camera_to_world(self, share: float) -> Array:
        position, slope = self._at(share)
        if self.target_m is not None:
            up_yaw = None if self.yaw_deg is None else math.radians(self.yaw_deg)
            return pose(look_at(position, np.array(self.target_m), up_yaw), position)
        return pose(orientation(math.atan2(slope[1], slope[0]), math.radians(self.pitch_deg)), position)

    def problem(self) -> str | None:
        points = np.array(self.points_m).reshape(-1, 3)
        if len(points) < 2:
            return "points_m: needs two places or more"
        if np.linalg.norm(np.diff(points, axis=0), axis=1).min() < 1:
            return "points_m: successive places must be at least a meter apart"
        if points[:, 2].min() < 1:
            return "points_m: must be above the ground, the third number is the altitude"
        if self.target_m is not None and self.target_m[2] >= points[:, 2].min():
            return "target_m: must be below the drone"
        return None
