"""USD files, read back by OpenUSD."""

import json
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aa4d.capture.reader import read_capture
from aa4d.export.clip import (
    FAINTEST,
    Clip,
    every_gaussian,
)
from aa4d.export.harmonics import SH_CONSTANT
from aa4d.export.usd_points import linear
from aa4d.filming.camera_path import path_of_frames
from aa4d.methods.model_file import load_model, save_model
from tests.export.scenes import left_out, riding

READ_USD = """
import json, sys
from pxr import Usd, UsdGeom
stage = Usd.Stage.Open(sys.argv[1])
points = UsdGeom.Points(stage.GetDefaultPrim().GetChildren()[0])
api = UsdGeom.PrimvarsAPI(points)
print(json.dumps({
    "up": UsdGeom.GetStageUpAxis(stage), "metres": UsdGeom.GetStageMetersPerUnit(stage),
    "fps": stage.GetTimeCodesPerSecond(), "end": stage.GetEndTimeCode(),
    "codes": points.GetPointsAttr().GetTimeSamples(),
    "points": [[list(p) for p in points.GetPointsAttr().Get(t)] for t in (0, 1)],
    "ids": [list(points.GetIdsAttr().Get(t)) for t in (0, 1)],
    "velocities": [[list(p) for p in points.GetVelocitiesAttr().Get(t)] for t in (0, 1)],
    "group": [list(api.GetPrimvar("group").Get(t)) for t in (0, 1)] if api.HasPrimvar("group") else None,
    "names": list(api.GetPrimvar("groupNames").Get()) if api.HasPrimvar("groupNames") else None,
    "widths": list(points.GetWidthsAttr().Get(1)),
    "colors": [list(c) for c in api.GetPrimvar("displayColor").Get(1)],
    "opacity": list(api.GetPrimvar("displayOpacity").Get(1)),
    "identity": json.loads(stage.GetRootLayer().customLayerData["aa4d"]),
}))
"""


def usd_of(run: Path, out: Path, views: str = "held-out") -> dict[str, Any]:
    """In processes of their own: Blender, which other tests load, brings a USD that is not to meet this one."""
    if find_spec("pxr") is None:
        pytest.skip("usd-core is not installed: pip install aa4d[export]")
    arguments = ("export", str(run), "--format", "usd-points", "--views", views, "--out", str(out))
    subprocess.run([sys.executable, "-m", "aa4d.cli", *arguments], check=True, timeout=120)
    read = subprocess.run(
        [sys.executable, "-c", READ_USD, str(out / "points.usdc")],
        check=True,
        capture_output=True,
        text=True,
        timeout=120,
    )
    stage: dict[str, Any] = json.loads(read.stdout)
    return stage


def test_usd_tells_the_groups_apart_and_how_fast_they_go(toy_run: Path, tmp_path: Path) -> None:
    loaded = riding(toy_run)
    capture = read_capture(toy_run.parent / "capture")
    save_model(
        tmp_path / "model.safetensors", loaded.method, loaded.model, is_static=False, capture=capture,
        frame=loaded.frame, background=loaded.background, training={"seconds": 1.0},
    )  # fmt: skip
    stage = usd_of(tmp_path, tmp_path / "out")
    assert stage["names"] == ["car 0", "car 1"]
    clip = Clip(loaded, path_of_frames(loaded, "held-out"), None)
    for index in (0, 1):
        g = clip.gaussians(index)
        assert g.group is not None
        assert stage["group"][index] == g.group.tolist()
        np.testing.assert_allclose(stage["velocities"][index], clip.velocities(index, g.ids), atol=0.02)


def test_usd_shows_each_frame_at_its_own_second(toy_run: Path, tmp_path: Path) -> None:
    loaded = left_out(load_model(toy_run / "model.safetensors"))
    capture = replace(read_capture(toy_run.parent / "capture"), frames=loaded.frames)
    save_model(
        tmp_path / "model.safetensors", loaded.method, loaded.model, is_static=False, capture=capture,
        frame=loaded.frame, background=loaded.background, training={"seconds": 1.0},
    )  # fmt: skip
    stage = usd_of(tmp_path, tmp_path / "out", "all")
    assert np.array(stage["codes"]) / stage["fps"] == pytest.approx([f.time_s for f in loaded.frames])
    assert stage["end"] / stage["fps"] == pytest.approx(15)


READ_USD_SPLATS = """
import json, sys
from pxr import Usd, UsdGeom, UsdVol
stage = Usd.Stage.Open(sys.argv[1])
splats = UsdVol.ParticleField3DGaussianSplat(stage.GetDefaultPrim().GetChildren()[0])
codes = splats.GetPositionsAttr().GetTimeSamples()
def rows(values):
    return [list(v) for v in values]
print(json.dumps({
    "type": splats.GetPrim().GetTypeName(), "up": UsdGeom.GetStageUpAxis(stage), "codes": codes,
    "degree": splats.GetRadianceSphericalHarmonicsDegreeAttr().Get(),
    "positions": [rows(splats.GetPositionsAttr().Get(t)) for t in (codes[0], codes[4], codes[-1])],
    "between": rows(splats.GetPositionsAttr().Get(0.5 * (codes[4] + codes[5]))),
    "next": rows(splats.GetPositionsAttr().Get(codes[5])),
    "scales": rows(splats.GetScalesAttr().Get(codes[4])),
    "rotations": [[q.GetReal(), *q.GetImaginary()] for q in splats.GetOrientationsAttr().Get(codes[4])],
    "opacities": list(splats.GetOpacitiesAttr().Get(codes[4])),
    "harmonics": rows(splats.GetRadianceSphericalHarmonicsCoefficientsAttr().Get(codes[4])),
}))
"""


def test_usd_plays_splats_that_have_every_attribute_of_the_model(toy_run: Path, tmp_path: Path) -> None:
    """Positions at three times, and between two; in processes of their own, as `usd_of`."""
    if find_spec("pxr") is None:
        pytest.skip("usd-core is not installed: pip install aa4d[export]")
    out = tmp_path / "out"
    command = ("export", str(toy_run), "--format", "usd", "--out", str(out))
    subprocess.run([sys.executable, "-m", "aa4d.cli", *command], check=True, timeout=120)
    reader = [sys.executable, "-c", READ_USD_SPLATS, str(out / "splats.usdc")]
    stage = json.loads(subprocess.run(reader, check=True, capture_output=True, text=True, timeout=120).stdout)
    loaded = load_model(toy_run / "model.safetensors")
    clip = Clip(loaded, path_of_frames(loaded, "all"), None)
    assert (stage["type"], stage["up"], stage["degree"]) == ("ParticleField3DGaussianSplat", "Z", 0)
    assert np.array(stage["codes"]) / clip.path.fps == pytest.approx([clip.seconds(i) for i in range(len(clip))])
    ids = np.array(sorted({int(i) for index in range(len(clip)) for i in clip.gaussians(index).ids}))
    for place, index in enumerate((0, 4, 9)):
        g = every_gaussian(loaded, clip.path.views[index].t, clip.eye_at(index))
        np.testing.assert_allclose(stage["positions"][place], g.means[ids], atol=1e-4)
    g = every_gaussian(loaded, clip.path.views[4].t, clip.eye_at(4))
    np.testing.assert_allclose(stage["scales"], g.scales[ids], rtol=1e-4)
    np.testing.assert_allclose(np.abs((stage["rotations"] * g.quaternions[ids]).sum(axis=1)), 1, atol=1e-5)
    np.testing.assert_allclose(stage["opacities"], np.where(g.opacities >= FAINTEST, g.opacities, 0)[ids], atol=1e-6)
    np.testing.assert_allclose(0.5 + SH_CONSTANT * np.array(stage["harmonics"]), g.colors[ids], atol=1e-5)
    middle = (np.array(stage["positions"][1]) + np.array(stage["next"])) / 2
    np.testing.assert_allclose(stage["between"], middle, atol=1e-4)


def test_usd_plays_the_points(clip: Clip, tmp_path: Path) -> None:
    stage = usd_of(clip.loaded.path.parent, tmp_path / "out")
    assert (stage["up"], stage["metres"], stage["end"]) == ("Z", 1.0, 1.0)
    assert stage["fps"] == pytest.approx(clip.path.fps)
    assert stage["identity"] == json.loads((tmp_path / "out/export.json").read_text())["identity"]
    for index in (0, 1):
        g = clip.gaussians(index)
        np.testing.assert_allclose(stage["points"][index], g.means, atol=1e-4)
        assert stage["ids"][index] == g.ids.tolist()
    np.testing.assert_allclose(stage["colors"], linear(g.colors), atol=1e-5)
    np.testing.assert_allclose(stage["widths"], 2 * g.scales.mean(1), rtol=1e-5)
    np.testing.assert_allclose(stage["velocities"][1], clip.velocities(1, g.ids), atol=1e-3)
    np.testing.assert_allclose(stage["opacity"], g.opacities, rtol=1e-5)
    assert stage["group"] is stage["names"] is None


def test_linear_light_is_that_of_the_standard() -> None:
    assert linear(np.array([0.0, 0.04045, 0.5, 1.0])) == pytest.approx([0, 0.0031308, 0.2140411, 1.0], abs=1e-6)
