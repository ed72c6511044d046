"""Flights and the truth that follows from them: nadir, the horizon, the camera's plane."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from aa4d.stress.cases import Part
from synth.camera import invert_rigid
from synth.flight.orientation import look_at, orientation, pose
from synth.lens import Pinhole

PART = Part("flight")
Array = NDArray[np.float64]


def off_rotation(matrix: Array) -> float:
    """How far a matrix [3, 3] is from a rotation."""
    if not np.isfinite(matrix).all():
        return math.inf
    return max(float(np.abs(matrix @ matrix.T - np.eye(3)).max()), abs(float(np.linalg.det(matrix)) - 1))


@PART.case(
    why="straight down a level horizon says nothing of the heading",
    done="up follows from the two angles",
    bound=1e-12,
    each={f"pitch {p:g}": p for p in (-math.pi / 2, -math.pi / 2 + 1e-12, 0.0, 1e-300, -2.0)},
)
def orientation_at(pitch: float) -> float:
    return max(off_rotation(orientation(yaw, pitch)) for yaw in (0.0, 1e-300, math.pi, -1e3))


@PART.case(
    why="a flight over nadir flips a camera that looks up its own way",
    done="no step of the picture larger than the turn",
    bound=1e-6,
)
def through_nadir() -> float:
    steps = [orientation(0.3, -math.pi / 2 + d) for d in np.linspace(-1e-3, 1e-3, 21)]
    return max(float(np.abs(b - a).max()) for a, b in pairwise(steps)) - 1e-4


TARGETS = {
    "straight below": ([0.0, 0, 100], [0.0, 0, 0]),
    "a micrometre off below": ([1e-6, 0, 100], [0.0, 0, 0]),
    "at the horizon": ([0.0, 0, 1], [1e4, 0, 1]),
    "a millimetre away": ([0.0, 0, 1], [1e-3, 0, 1]),
    "1e-150 m away": ([0.0, 0, 1e-150], [1e-150, 0, 0]),
    "1e200 m away": ([0.0, 0, 0], [1e200, 1e200, -1e200]),
}


@PART.case(
    why="straight above its target a camera has no heading; lengths under- and overflow",
    done="north is up there; the direction is normalised in float64",
    bound=1e-12,
    each=TARGETS,
)
def looking_at(places: tuple[list[float], list[float]]) -> float:
    return off_rotation(look_at(np.array(places[0]), np.array(places[1]), None))


@PART.case(
    why="a matrix inverted as a general one loses digits far from the origin",
    done="inverted as a rotation and a translation",
    bound=1e-9,
    each={f"{d:g} m": d for d in (1.0, 1e4)},
)
def inverse_of_a_pose(distance: float) -> float:
    matrix = pose(orientation(0.7, -1.1), np.array([distance, -distance, distance]))
    return float(np.abs(invert_rigid(matrix) @ matrix - np.eye(4)).max())


@PART.case(why="points at and behind the camera's plane, or infinitely far", done="NaN where none is in front")
def projection_at_the_plane() -> float:
    lens = Pinhole(np.array([[100.0, 0, 50], [0, 100.0, 40], [0, 0, 1]]))
    with np.errstate(over="ignore", invalid="ignore"):
        found = lens.project(np.array([[1.0, 1, 0], [1, 1, -1e-300], [0, 0, 1e300], [0, 0, 1e-300]]))
    return 0.0 if np.isnan(found[:2]).all() and np.allclose(found[2:], [50, 40]) else math.inf
