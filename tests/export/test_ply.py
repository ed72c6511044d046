"""PLYs of splats and of points hold what the model shows, in metres."""

import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plyfile import PlyData

from aa4d.export import export
from aa4d.export.clip import (
    VIEWER,
    Clip,
    world_gaussians,
)
from aa4d.export.splat_ply import write_splat_ply
from aa4d.filming.camera_path import View, looking_at
from aa4d.filming.layers import draw
from tests.export.scenes import read_splats, seen_in_metres
from tests.toy_run import silent


@pytest.mark.parametrize("axes", ["world", "viewer"])
def test_splats_look_like_the_model(clip: Clip, tmp_path: Path, axes: str) -> None:
    """Positions, scales and rotations in metres: the file drawn with a metric camera is the model's own picture."""
    export(replace(clip, axes=axes), "ply", tmp_path / "out", silent)
    turn = np.eye(3) if axes == "world" else VIEWER.as_matrix()
    for view in clip.path.views:
        shown = seen_in_metres(read_splats(tmp_path / f"out/clip_{view.name}.ply"), clip.loaded, view, turn)
        expected = draw(clip.loaded, view, clip.loaded.camera, ["color"]).color
        difference = np.abs(shown.astype(int) - expected.astype(int))
        assert difference.mean() < 0.1
        assert (difference > 3).mean() < 0.01


@pytest.mark.parametrize("height_m", [0.7, 2.0, 6.0])
def test_close_to_the_ground_the_model_draws_what_its_splats_do(clip: Clip, tmp_path: Path, height_m: float) -> None:
    """Where most of the picture belongs to anchors whose centres project beyond it."""
    view = View("low", 0.4, looking_at(np.array([-3.0, -2.0, height_m]), np.array([1.0, 1.0, height_m / 2])))
    write_splat_ply(tmp_path / "low.ply", world_gaussians(clip.loaded, view.t, view.center()))
    shown = seen_in_metres(read_splats(tmp_path / "low.ply"), clip.loaded, view, np.eye(3))
    expected = draw(clip.loaded, view, clip.loaded.camera, ["color"]).color
    difference = np.abs(shown.astype(int) - expected.astype(int))
    assert difference.mean() < 0.1
    assert (difference > 3).mean() < 0.01


def test_points_hold_the_centres_in_metres(clip: Clip, tmp_path: Path) -> None:
    export(clip, "points", tmp_path / "out", silent)
    g = clip.gaussians(1)
    vertex = PlyData.read(str(tmp_path / "out/000008.ply"))["vertex"].data
    np.testing.assert_allclose(np.stack([vertex[n] for n in "xyz"], 1), g.means, atol=1e-4)
    np.testing.assert_allclose(vertex["red"], g.colors[:, 0] * 255, atol=0.5001)
    np.testing.assert_allclose(vertex["radius"], g.scales.mean(1), rtol=1e-5)
    # The toy's ground lies at z = 0 and spans some 30 metres.
    assert abs(np.median(vertex["z"])) < 2
    assert np.ptp(vertex["x"]) > 20


@pytest.mark.slow
def test_a_real_splat_tool_reads_the_same_splats(clip: Clip, tmp_path: Path) -> None:
    """PlayCanvas's splat-transform, which SuperSplat is built on, reads the PLY and writes what it has read."""
    npx = shutil.which("npx")
    if npx is None:
        pytest.skip("npx is not installed")
    export(clip, "ply", tmp_path / "out", silent)
    source, table, viewer = tmp_path / "out/clip_000008.ply", tmp_path / "read.csv", tmp_path / "view.html"
    command = [npx, "--yes", "@playcanvas/splat-transform"]
    if subprocess.run([*command, "--version"], capture_output=True, timeout=300).returncode:
        pytest.skip("the npm package @playcanvas/splat-transform cannot be had")
    for target in (table, viewer):
        subprocess.run([*command, "-q", str(source), str(target)], check=True, timeout=300)
    read = np.genfromtxt(table, delimiter=",", names=True)
    vertex = PlyData.read(str(source))["vertex"].data
    assert len(read) == len(vertex)
    for name in ("x", "y", "z", "f_dc_0", "f_dc_2", "opacity", "scale_0", "scale_2", "rot_0", "rot_3"):
        np.testing.assert_allclose(read[name], vertex[name], rtol=1e-5, atol=1e-6)
    assert viewer.stat().st_size > 1e6
