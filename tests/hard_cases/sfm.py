"""Structure from motion: alignments without a baseline, positions at the poles, matrices that are nearly none."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from aa4d.capture.gnss import Position, east_north_up, read_subtitles
from aa4d.capture.orientation import Similarity, umeyama
from aa4d.capture.pose_error import in_other_world, pose_error
from aa4d.capture.schema import is_rigid, matrix_of, number_of, pose_of
from aa4d.errors import InputError
from aa4d.stress.cases import Part
from tests.capture import aerial
from tests.hard_cases.errors import refusal

PART = Part("sfm")
Array = NDArray[np.float64]
POINTS = np.random.default_rng(0).normal(size=(30, 3))


@PART.case(
    why="a world 1e7 m away, a millionth or a million times as large",
    done="fitted about the means, in float64",
    bound=1e-6,
    each={f"scale {s:g}, {d:g} m away": (s, d) for s in (1e-6, 1.0, 1e6) for d in (0.0, 1e7)},
)
def similarity_of(given: tuple[float, float]) -> float:
    """Of the points, relative to their extent and what float64 keeps of their distance."""
    scale, away = given
    truth = Similarity(scale, Rotation.from_rotvec([0.4, -2, 1]).as_matrix(), np.array([away, -away, away]))
    target = truth.of_points(POINTS)
    found = umeyama(POINTS, target)
    return float(np.abs(found.of_points(POINTS) - target).max() / (scale + 1e-3 * away))


DEGENERATE = {
    "on a line": POINTS * [1, 0, 0],
    "in a plane": POINTS * [1, 1, 0],
    "in one place": POINTS * 0 + 3.0,
    "mirrored": POINTS,
}


@PART.case(
    why="a hover has no baseline, a straight flight a free roll; a mirror is no rotation",
    done="a rotation in every case; finite",
    bound=1e-9,
    each=DEGENERATE,
)
def similarity_of_points(points: Array) -> float:
    found = umeyama(points, points * [1, 1, -1] if points is POINTS else points)
    if not (np.isfinite(found.rotation).all() and math.isfinite(found.scale)):
        return math.inf
    return max(
        float(np.abs(found.rotation @ found.rotation.T - np.eye(3)).max()), abs(np.linalg.det(found.rotation) - 1)
    )


@PART.case(
    why="angles of a millionth of a degree: the cosine has no digits for them",
    done="by the antisymmetric part",
    bound=1e-3,
    each={f"{a:g} degrees": a for a in (1e-6, 1e-3, 1.0)},
)
def rotation_error_of(angle: float) -> float:
    truth = np.array(aerial.arc(12))
    found = truth.copy()
    for i, matrix in enumerate(found):
        axis = [1.0, 0, 0] if i % 2 else [-1.0, 0, 0]
        turn = Rotation.from_rotvec(np.radians(angle) * np.array(axis)).as_matrix()
        centre = -matrix[:3, :3].T @ matrix[:3, 3]
        matrix[:3, :3] = turn @ matrix[:3, :3]
        matrix[:3, 3] = -matrix[:3, :3] @ centre
    return abs(pose_error(found, truth, 40.0).rotation_deg / angle - 1)


@PART.case(why="the same cameras in a world of another size", done="no error", bound=1e-6)
def a_world_of_its_own() -> float:
    truth = np.array(aerial.arc(12))
    world = Similarity(1e-4, Rotation.from_rotvec([0.4, -2, 1]).as_matrix(), np.array([1e4, 0, 0]))
    error = pose_error(in_other_world(truth, world), truth, 40.0)
    return max(error.trajectory_m, error.rotation_deg)


PLACES = {
    "at the north pole": Position(90.0, 0.0, 10.0),
    "across the date line": Position(10.0, 180.0, 10.0),
    "below the sea": Position(-0.0001, 0.0, -400.0),
}


@PART.case(
    why="at the poles a longitude means nothing; the date line jumps by 360 degrees",
    done="through geocentric metres; against a metre north of there",
    bound=1e-3,
    each=PLACES,
)
def metres_from(origin: Position) -> float:
    """A step of 1e-5 degrees south is 1.1 m, wherever; across the date line it is as long."""
    south = Position(origin.latitude_deg - 1e-5, -origin.longitude_deg, origin.altitude_m)
    found = east_north_up([origin, south], origin)
    a, e2 = 6378137.0, 6.69437999014e-3
    sine = math.sin(math.radians(origin.latitude_deg))
    radius = a * (1 - e2) / (1 - e2 * sine**2) ** 1.5 + origin.altitude_m
    return float(np.abs(found - [[0, 0, 0], [0, -math.radians(1e-5) * radius, 0]]).max())


SUBTITLES = "1\n00:00:00,000 --> 00:00:01,000\n{}\n"


@PART.case(
    why="a drone without a fix writes zeros, or numbers that no place has",
    done="no position rather than a wrong one",
    each={
        "zeros": "[latitude: 0.0] [longitude: 0.0]",
        "beyond the pole": "[latitude: 91.0] [longitude: 5.0]",
        "nothing": "",
        "half": "[latitude: 48.0]",
    },
)
def subtitles_without_a_fix(text: str) -> float:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.SRT"
        path.write_text(SUBTITLES.format(text))
        return 0.0 if read_subtitles(path) is None else math.inf


@PART.case(
    why="a pose that is nearly one: a mirror, a zero, a scale, NaN",
    done="refused in one sentence",
    each={
        "a mirror": np.diag([1.0, 1, -1, 1]),
        "zero": np.zeros((4, 4)),
        "a scale": np.diag([2.0, 2, 2, 1]),
        "1e200": np.eye(4) * 1e200,
        "NaN": np.full((4, 4), np.nan),
        "a last row": np.eye(4) + np.eye(4)[[3, 2, 1, 0]] * 1e-3,
    },
)
def poses_that_are_none(matrix: Array) -> float:
    assert not is_rigid(matrix, 1e-4)
    return refusal(InputError, lambda: pose_of(matrix.tolist(), "frame", Path("capture.json")), "capture.json")


@PART.case(
    why="numbers that JSON can hold",
    done="refused with the file and the key",
    each={
        "10^400": 10**400,
        "NaN": math.nan,
        "1e999": math.inf,
        "true": True,
        "a text": "5",
        "nothing": None,
    },
)
def numbers_that_are_none(value: object) -> float:
    path = Path("capture.json")
    return max(
        refusal(InputError, lambda: number_of({"fps": value}, "fps", path), "capture.json", "fps"),
        refusal(InputError, lambda: matrix_of([value, 1, 2], (3,), "K", path), "capture.json", "K")
        if not isinstance(value, bool | str)
        else 0.0,
    )
