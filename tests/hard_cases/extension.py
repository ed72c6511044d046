"""The extension's own evaluation with numpy, held to the trained model's; ellipsoids under affine maps."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import numpy as np
import torch
from model_files import make_model, write_model

from aa4d.methods.model_file import load_model
from aa4d.stress.cases import Part
from addon import names
from addon.affine import fit, moved, quaternions_of, rotations_of
from addon.field import anchor_positions, prepare
from addon.model import read_model

PART = Part("extension")


def difference(t: float, scale: float = 1.0, **options: object) -> float:
    """Between the places of anchors in both readers, model units, with all network weights scaled."""
    tensors, information = make_model(50, **options)  # type: ignore[arg-type]
    for name in tensors:
        if name.endswith((".hidden.weight", "encoder.weight")):
            tensors[name] *= np.float32(scale)
    with tempfile.TemporaryDirectory() as folder:
        path = write_model(Path(folder) / "model.safetensors", tensors, information)
        ours, theirs = read_model(path), load_model(path)
    found = anchor_positions(prepare(ours), t)
    with torch.no_grad():
        truth = theirs.model.double().centers(None if theirs.is_static else t).numpy()
    if not np.isfinite(found).all():
        return math.inf
    return float(np.abs(found - truth).max() / max(1.0, np.abs(truth).max()))


@PART.case(
    why="the first and the last frame, and times that float32 cannot tell from them",
    done="clamped rows of the planes",
    bound=2e-5,
    each={str(t): t for t in (0.0, 1e-40, 0.5, 1 - 6e-8, 1.0)},
)
def places_at(t: float) -> float:
    return difference(t)


@PART.case(
    why="networks that training saturated or let die",
    done="the same formulas, and no exponential that overflows",
    bound=5e-5,
    each={f"weights times {s:g}": s for s in (1e-20, 1e-3, 30.0, 1e3)},
)
def networks_scaled(scale: float) -> float:
    return difference(0.37, scale)


@PART.case(
    why="groups that appear at an instant and turn by many radians",
    done="the spline and the rotation in float64",
    bound=5e-5,
    each={str(t): t for t in (0.0, 0.4, 1.0)},
)
def riders_at(t: float) -> float:
    return difference(t, groups=3)


@PART.case(
    why="one anchor; every aggregation",
    done="the same numbers",
    bound=2e-5,
    each={a: a for a in ("product", "mean", "anchor_only", "time_only", "acfa")},
)
def aggregations(aggregation: str) -> float:
    return difference(0.7, aggregation=aggregation)


TURNS = {
    "half turns": np.array([[0.0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]),
    "almost a half turn": np.array([[1e-7, 1, 0, 0], [-1e-7, 0.6, 0.8, 0], [1e-9, 0, 0, 1]]),
    "no turn": np.array([[1.0, 0, 0, 0], [1, 1e-9, 0, 0], [-1, 0, 0, 0]]),
}


@PART.case(
    why="a quaternion from a rotation's trace alone divides by zero at half a turn",
    done="the largest component is found first",
    bound=1e-6,
    each=TURNS,
)
def quaternion_there_and_back(quaternions: np.ndarray) -> float:
    unit = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).astype(np.float32)
    back = quaternions_of(rotations_of(unit))
    return float(np.abs(rotations_of(back) - rotations_of(unit)).max())


MAPS = {
    "mirrored": np.diag([-1.0, 1, 1]),
    "flattened": np.diag([1.0, 1, 0]),
    "sheared": np.array([[1.0, 3, 0], [0, 1, 0], [0, 0, 1]]),
    "scaled by 1e-6": np.eye(3) * 1e-6,
    "scaled by 1e6": np.eye(3) * 1e6,
}


@PART.case(
    why="shears, mirrors and flat maps are no rotation",
    done="the map's own ellipsoid by singular values",
    bound=2e-6,
    each=MAPS,
)
def ellipsoids_under_a_map(linear: np.ndarray) -> float:
    """Against the covariance of the moved ellipsoid, relative to its largest entry."""
    random = np.random.default_rng(0)
    q = random.normal(size=(20, 4)).astype(np.float32)
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    scales = np.exp(random.normal(size=(20, 3))).astype(np.float32)
    matrix = np.eye(4)
    matrix[:3, :3] = linear
    before = {names.POSITION: np.zeros((20, 3), np.float32), names.SCALE: scales, names.ROTATION: q}
    after = moved(before, matrix)
    worst = 0.0
    for i in range(20):
        axes = linear @ rotations_of(q)[i] * scales[i]
        found = rotations_of(after[names.ROTATION])[i] * after[names.SCALE][i]
        truth = axes @ axes.T
        worst = max(worst, float(np.abs(found @ found.T - truth).max() / np.abs(truth).max()))
    return worst if math.isfinite(worst) else math.inf


@PART.case(
    why="points on a line or in one place tell nothing of some axes",
    done="those axes stay as they are",
    bound=1e-5,
    each={"a line": 1, "a plane": 2, "one point": 0},
)
def fit_of_flat_points(dimensions: int) -> float:
    points = np.zeros((9, 3), np.float32)
    points[:, :dimensions] = np.random.default_rng(1).normal(size=(9, dimensions))
    matrix = np.eye(4)
    matrix[:3, 3] = [3, -2, 1]
    found = fit(points, points + np.array([3, -2, 1], np.float32))
    return math.inf if found is None else float(np.abs(found - matrix).max())
