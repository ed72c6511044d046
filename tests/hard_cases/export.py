"""Exports: Gaussians at the ends of what other formats can say."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import numpy as np
from plyfile import PlyData

from aa4d.export.clip import FAINTEST, WorldGaussians
from aa4d.export.harmonics import SH_CONSTANT
from aa4d.export.splat_ply import write_splat_ply
from aa4d.export.usd_points import linear
from aa4d.stress.cases import Part
from addon.splat_ply import srgb, write_ply

PART = Part("export")


def gaussians(**changes: object) -> WorldGaussians:
    values: dict[str, object] = {
        "ids": np.arange(2),
        "means": np.array([[9999.0, -9999, 0], [0, 0, 0]]),
        "quaternions": np.array([[1.0, 0, 0, 0], [0.5, 0.5, 0.5, 0.5]]),
        "scales": np.array([[0.5, 1.0, 2.0], [1, 1, 1]]),
        "opacities": np.array([0.5, 0.5]),
        "colors": np.array([[0.0, 1, 0.5], [1, 1, 1]]),
    }
    return WorldGaussians(**(values | changes))  # type: ignore[arg-type]


def columns_of(g: WorldGaussians) -> dict[str, np.ndarray]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.ply"
        write_splat_ply(path, g)
        vertex = PlyData.read(str(path))["vertex"].data
        return {name: np.array(vertex[name], np.float64) for name in vertex.dtype.names}


@PART.case(
    why="an opacity is written as a logit, infinite at one",
    done="a millionth below one at most",
    bound=2e-6,
    each={"1": 1.0, "almost 1": 1 - 1e-16, "the faintest": FAINTEST},
)
def opacity_of(value: float) -> float:
    found = columns_of(gaussians(opacities=np.array([value, 0.5])))["opacity"][0]
    return abs(1 / (1 + math.exp(-found)) - value) if math.isfinite(found) else math.inf


@PART.case(
    why="a scale is written as its logarithm, infinite at zero",
    done="a nanometre at least",
    bound=1e-6,
    each={"0": 0.0, "1e-30 m": 1e-30, "1 km": 1e3},
)
def scale_of(value: float) -> float:
    found = math.exp(columns_of(gaussians(scales=np.array([[value, 1, 1], [1, 1, 1]])))["scale_0"][0])
    return abs(found - max(value, 1e-9)) / max(value, 1.0)


@PART.case(
    why="10 km from the origin float32 keeps a millimetre", done="refused beyond; as accurate within", bound=1e-3
)
def place_at_the_edge_of_the_world() -> float:
    return float(np.abs(columns_of(gaussians())["x"] - [9999.0, 0]).max())


@PART.case(why="colors of exactly 0 and 1 as coefficients of harmonics", done="come back to a millionth", bound=1e-6)
def colors_at_their_ends() -> float:
    found = 0.5 + SH_CONSTANT * columns_of(gaussians())["f_dc_0"]
    return float(np.abs(found - [0.0, 1.0]).max())


@PART.case(why="nothing to draw in a view", done="a file of no points")
def no_gaussians() -> float:
    none = WorldGaussians(*(np.zeros((0, *s)) for s in ((), (3,), (4,), (3,), (), (3,))))
    return float(len(columns_of(none)["x"]))


@PART.case(
    why="sRGB's curve has a kink near black, and no root of negative values",
    done="linear below it; there and back",
    bound=1e-6,
)
def srgb_there_and_back() -> float:
    values = np.array([0.0, 1e-30, 0.0031308, 0.04045, 0.0404500001, 0.5, 1.0])
    return float(np.abs(srgb(linear(values).astype(np.float32)) - values).max())


@PART.case(
    why="the extension's own PLY of opaque, invisible and infinitely thin points", done="the same floors as aa4d's"
)
def the_extensions_ply() -> float:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.ply"
        one = np.ones((3, 3), np.float32)
        write_ply(
            path,
            one,
            one * 0,
            np.array([1.0, 0.0, 0.5], np.float32),
            one * 0,
            np.tile(np.array([1, 0, 0, 0], np.float32), (3, 1)),
        )
        vertex = PlyData.read(str(path))["vertex"].data
    return 0.0 if all(np.isfinite(vertex[name]).all() for name in vertex.dtype.names) else math.inf
