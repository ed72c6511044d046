"""Exports read back by other programs' readers hold what the model shows, in metres."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from plyfile import PlyData
from scipy.spatial import KDTree

from aa4d.capture.reader import read_capture
from aa4d.errors import InputError
from aa4d.evaluation.views import as_picture
from aa4d.export import EXPORTERS, export
from aa4d.export.clip import (
    FAINTEST,
    VIEWER,
    Clip,
    WorldGaussians,
    every_gaussian,
    mean_eye,
    turned,
    world_gaussians,
)
from aa4d.export.origin import geographic_origin
from aa4d.export.splat_ply import SH_CONSTANT, write_splat_ply
from aa4d.export.usd_points import linear
from aa4d.filming.camera_path import View, looking_at, path_of_frames, resampled, with_time
from aa4d.filming.layers import draw
from aa4d.methods.model_file import LoadedModel, load_model, save_model
from aa4d.motion.tracks import ALWAYS
from aa4d.raster import rasterize
from aa4d.raster.types import Camera, Gaussians
from tests.toy_riders import ride
from tests.toy_run import silent


@pytest.fixture(scope="module")
def loaded(toy_run: Path) -> LoadedModel:
    return load_model(toy_run / "model.safetensors")


@pytest.fixture(scope="module")
def clip(loaded: LoadedModel) -> Clip:
    return Clip(loaded, path_of_frames(loaded, "held-out"), None)


def read_splats(path: Path) -> Gaussians:
    """As a splat viewer decodes the file."""
    vertex = PlyData.read(str(path))["vertex"]

    def columns(*names: str) -> torch.Tensor:
        return torch.from_numpy(np.stack([np.asarray(vertex[n], np.float32) for n in names], axis=1))

    return Gaussians(
        means=columns("x", "y", "z"),
        quaternions=columns("rot_0", "rot_1", "rot_2", "rot_3"),
        scales=columns("scale_0", "scale_1", "scale_2").exp(),
        opacities=torch.sigmoid(columns("opacity"))[:, 0],
        colors=(0.5 + SH_CONSTANT * columns("f_dc_0", "f_dc_1", "f_dc_2")).clamp(0, 1),
    )


def seen_in_metres(gaussians: Gaussians, loaded: LoadedModel, view: View, turn: NDArray[np.float64]) -> NDArray:
    """The view's picture of Gaussians that live in metres, in a world turned by `turn`."""
    pinhole, viewmat = loaded.camera, view.viewmat.copy()
    viewmat[:3, :3] = viewmat[:3, :3] @ turn.T
    camera = Camera(
        torch.from_numpy(viewmat).float(), torch.from_numpy(pinhole.K).float(), pinhole.width, pinhole.height, near=0.2
    )
    return as_picture(rasterize(gaussians, camera, background=torch.tensor(loaded.background)).color)


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


def test_the_viewers_axes_have_the_sky_up() -> None:
    one = WorldGaussians(
        ids=np.array([0]),
        means=np.array([[1.0, 2.0, 3.0]]),
        quaternions=np.array([[1.0, 0, 0, 0]]),
        scales=np.array([[1.0, 2.0, 3.0]]),
        opacities=np.array([0.5]),
        colors=np.array([[0.5, 0.5, 0.5]]),
    )
    moved = turned(one, VIEWER)
    assert moved.means[0] == pytest.approx([1, -3, 2])  # east stays right, up is against y, north is ahead
    assert np.abs(moved.quaternions[0]) == pytest.approx([np.sqrt(0.5), np.sqrt(0.5), 0, 0])


def test_whose_view_is_kept(clip: Clip) -> None:
    """Anchors decode by direction: each view's own camera, or one for all."""
    first, last = clip.path.views
    assert np.array_equal(clip.gaussians(0).colors, world_gaussians(clip.loaded, first.t, first.center()).colors)
    eye = mean_eye(clip.path)
    assert eye == pytest.approx((first.center() + last.center()) / 2)
    fixed = replace(clip, eye=eye)
    assert np.array_equal(fixed.gaussians(1).colors, world_gaussians(clip.loaded, last.t, eye).colors)
    far = world_gaussians(clip.loaded, first.t, np.array([300.0, 0, 5]))
    near = clip.gaussians(0)
    common = np.intersect1d(far.ids, near.ids, return_indices=True)[1:]
    assert np.abs(far.colors[common[0]] - near.colors[common[1]]).max() > 1e-3


def test_nothing_drawn_is_left_out_and_nothing_faint_kept(loaded: LoadedModel) -> None:
    g = world_gaussians(loaded, 0.5, np.array([0.0, 0, 20]))
    assert g.opacities.min() >= FAINTEST
    np.testing.assert_allclose(np.linalg.norm(g.quaternions, axis=1), 1, atol=1e-12)
    assert (g.quaternions[:, 0] >= 0).all()
    assert (g.ids < loaded.model.anchors.offset.shape[0] * loaded.model.anchors.offset.shape[1]).all()


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


def riding(toy_run: Path) -> LoadedModel:
    """The first third of the anchors rides with the square, the second on a group that leaves at t = 0.5."""
    loaded = load_model(toy_run / "model.safetensors")
    n = len(loaded.model.anchors)
    group = torch.full((n,), -1)
    group[: n // 3], group[n // 3 : 2 * n // 3] = 0, 1
    ride(loaded, group, shown=(ALWAYS, (-2, -1, 0.4, 0.5)))
    return loaded


def test_riders_are_exported_where_they_are_and_absent_groups_are_left_out(toy_run: Path, tmp_path: Path) -> None:
    loaded = riding(toy_run)
    clip = Clip(loaded, path_of_frames(loaded, "held-out"), np.array([0.0, 0, 20]))
    first, later = clip.gaussians(0), clip.gaussians(1)  # t = 0 and 8/9
    assert first.group is not None
    assert later.group is not None
    assert set(first.group) == {-1, 0, 1}
    assert set(later.group) == {-1, 0}
    _, rows, rows_later = np.intersect1d(first.ids, later.ids, return_indices=True)
    rides = first.group[rows] == 0
    moved = later.means[rows_later] - first.means[rows]
    np.testing.assert_allclose(moved[rides], [[12 * 8 / 9, 0, 0]] * rides.sum(), atol=1e-3)
    np.testing.assert_allclose(moved[~rides], 0, atol=1e-3)
    for name in ("points", "ply"):
        export(clip, name, tmp_path / name, silent)
        prefix = "clip_" if name == "ply" else ""
        vertex = PlyData.read(str(tmp_path / name / f"{prefix}000008.ply"))["vertex"].data
        np.testing.assert_allclose(np.stack([vertex[n] for n in "xyz"], 1), later.means, atol=1e-4)
        # The layout of splats is fixed; that of points is free.
        assert ("group" in (vertex.dtype.names or ())) == (name == "points")
    np.testing.assert_array_equal(PlyData.read(str(tmp_path / "points/000008.ply"))["vertex"]["group"], later.group)


def test_velocities_are_those_of_the_square(toy_run: Path) -> None:
    """12 m in nine tenths of a second; on a path of twice as many views at the same rate, half as fast."""
    loaded = riding(toy_run)
    for views, speed in ((10, 12 / 0.9), (19, 12 / 1.8)):
        path = resampled(path_of_frames(loaded, "all"), views)
        clip = Clip(loaded, replace(path, fps=10.0, at=np.arange(views) / 10), None)
        for index in (0, 4, views - 1):
            g = clip.gaussians(index)
            assert g.group is not None
            expected = np.where(g.group >= 0, speed, 0.0)
            velocity = clip.velocities(index, g.ids)
            np.testing.assert_allclose(velocity, np.stack([expected, 0 * expected, 0 * expected], 1), atol=0.02)
        turned_ = replace(clip, axes="viewer").velocities(4, clip.gaussians(4).ids)
        np.testing.assert_allclose(turned_, VIEWER.apply(clip.velocities(4, clip.gaussians(4).ids)), atol=1e-6)
    frozen = Clip(loaded, with_time(path_of_frames(loaded, "all"), 0.5), None)
    assert np.abs(frozen.velocities(3, frozen.gaussians(3).ids)).max() < 1e-6


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


def left_out(loaded: LoadedModel) -> LoadedModel:
    """The model of a film of whose frames some were left out: the first five a second apart, then a gap of six."""
    seconds = [0.0, 1.0, 2.0, 3.0, 4.0, 10.0, 11.0, 12.0, 12.5, 15.0]
    frames = tuple(replace(f, time_s=s) for f, s in zip(loaded.frames, seconds, strict=True))
    return replace(loaded, frames=frames)


def test_velocities_over_a_gap_are_those_of_its_seconds(toy_run: Path) -> None:
    loaded = left_out(riding(toy_run))
    clip = Clip(loaded, path_of_frames(loaded, "all"), None)
    step_m = 12 / 9
    # Half a step of one second before frame 4, half a gap of six after it.
    for index, speed in ((1, step_m), (4, step_m / 3.5), (9, step_m / 2.5)):
        g = clip.gaussians(index)
        assert g.group is not None
        np.testing.assert_allclose(clip.velocities(index, g.ids)[:, 0], np.where(g.group >= 0, speed, 0), atol=0.02)


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


def test_4dgs_shows_each_frame_at_its_own_second(toy_run: Path, tmp_path: Path) -> None:
    fourdgs = pytest.importorskip("fourdgs", reason="pip install aa4d[export]")
    loaded = left_out(riding(toy_run))
    clip = Clip(loaded, path_of_frames(loaded, "all"), np.array([0.0, 0, 20]))
    export(clip, "4dgs", tmp_path / "out", silent)
    scene = fourdgs.read(str(tmp_path / "out/scene.4dgs"))
    assert scene.duration_sec == pytest.approx(15 + 15 / 9)
    for index, second in ((0, 0.0), (4, 4.0), (5, 10.0), (8, 12.5)):
        away, _ = KDTree(scene.state_at(second + 1e-4)["centers"]).query(clip.gaussians(index).means)
        assert away.max() < 0.2  # what rides moves 12 / 9 m from one frame to the next


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


def test_4dgs_holds_every_view_and_moves_between_them(loaded: LoadedModel, tmp_path: Path) -> None:
    fourdgs = pytest.importorskip("fourdgs", reason="pip install aa4d[export]")
    clip = Clip(loaded, resampled(path_of_frames(loaded, "all"), 4), np.array([0.0, 0, 20]))
    export(clip, "4dgs", tmp_path / "out", silent)
    path = tmp_path / "out/scene.4dgs"
    checked = subprocess.run([sys.executable, "-m", "fourdgs.cli", "validate", str(path)], capture_output=True)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    # Its own converters place it without being told its axes.
    for command, name in (("to-usd", "one.usda"), ("to-gltf", "one.glb")):
        arguments = [sys.executable, "-m", "fourdgs.cli", command, str(path), "-o", str(tmp_path / name)]
        converted = subprocess.run(arguments, capture_output=True, text=True, timeout=120)
        assert converted.returncode == 0, converted.stderr
        assert (tmp_path / name).stat().st_size > 1000
    scene = fourdgs.read(str(path))
    assert scene.duration_sec == pytest.approx(clip.seconds(4))
    assert scene.provenance.frame.metres_per_unit == 1
    identity = json.loads((tmp_path / "out/export.json").read_text())["identity"]
    assert json.loads(scene.header.attributes["aa4d"]) == identity
    bounds = scene.quantization.bounds
    slack = 1e-3 + float(bounds["pos"]) + float(bounds["motion"]) * clip.seconds(1)
    for index in range(4):
        g = clip.gaussians(index)
        # Just after the view's instant; the file keeps times in float32.
        state = scene.state_at(clip.seconds(index) + 1e-4)
        assert len(state["centers"]) == len(g.ids)
        away, _ = KDTree(state["centers"]).query(g.means)
        assert away.max() < np.sqrt(3) * slack
        assert state["opacity"].mean() == pytest.approx(g.opacities.mean(), abs=float(bounds["alpha"]))


def test_between_two_views_a_gaussian_moves_straight_and_a_vanishing_one_stays() -> None:
    slots = pytest.importorskip("aa4d.export.fourdgs_container", reason="pip install aa4d[export]")

    def at(ids: list[int], x: list[float]) -> WorldGaussians:
        n = len(ids)
        means = np.stack([np.array(x), np.zeros(n), np.zeros(n)], axis=1)
        turned_ = np.tile([0.5, 0.1, 0.2, 0.3], (n, 1))
        return WorldGaussians(np.array(ids), means, turned_, np.ones((n, 3)), np.full(n, 0.5), np.full((n, 3), 0.2))

    slot = slots._slot(at([3, 7, 9], [0.0, 5.0, 1.0]), at([2, 3, 9], [8.0, 2.0, -1.0]), 1.0, 1.5)
    assert slot["motions"][:, 0].tolist() == [4, 0, -4]  # metres a second
    for t, x in ((1.0, [0, 5, 1]), (1.25, [1, 5, 0]), (1.5, [2, 5, -1])):
        assert (slot["positions"] + slot["motions"] * (t - slot["mu_t"])[:, None])[:, 0].tolist() == x
    assert (slot["win_lo"] == 1).all()
    assert (slot["win_hi"] == 1.5).all()
    assert slot["rotations"][0].tolist() == [0.1, 0.2, 0.3, 0.5]  # x y z w


@pytest.mark.parametrize("name", ["ply", "points"])
def test_a_stopped_export_continues(clip: Clip, tmp_path: Path, name: str) -> None:
    out, prefix = tmp_path / "out", "clip_" if name == "ply" else ""

    def stop(_done: int, _total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export(clip, name, out, stop)
    assert sorted(p.name for p in out.iterdir()) == [f"{prefix}000000.ply", "export.json"]
    kept = (out / f"{prefix}000000.ply").stat().st_mtime_ns
    export(clip, name, out, silent)
    assert (out / f"{prefix}000000.ply").stat().st_mtime_ns == kept
    assert sorted(p.name for p in out.iterdir()) == [f"{prefix}000000.ply", f"{prefix}000008.ply", "export.json"]
    settings = json.loads((out / "export.json").read_text())
    assert settings["exporter"] == name
    assert settings["identity"]["made_from"] == {"model": clip.loaded.identity.digest()}
    *others, comment = PlyData.read(str(out / f"{prefix}000008.ply")).comments
    assert others == (["SplatRenderMode: default"] if name == "ply" else [])
    assert json.loads(comment.removeprefix("aa4d ")) == settings["identity"]
    of_old = {key: value for key, value in settings.items() if key != "identity"}
    (out / "export.json").write_text(json.dumps(of_old))
    export(clip, name, out, silent)
    (out / "export.json").write_text(json.dumps(of_old | {"model_sha256": "0"}))
    with pytest.raises(InputError, match="holds an export with other settings"):
        export(clip, name, out, silent)
    assert [v["t"] for v in settings["views"]] == [v.t for v in clip.path.views]


def test_where_on_earth_it_is_goes_along_while_the_capture_knows(toy_run: Path, tmp_path: Path) -> None:
    origin = {"latitude_deg": 52.5, "longitude_deg": 13.4, "altitude_m": 34.0}
    capture = tmp_path / "capture"
    capture.mkdir()
    loaded = replace(load_model(toy_run / "model.safetensors"), capture_folder=capture)
    for world, expected in ((origin, origin), (origin | {"altitude_m": "high"}, None), (None, None)):
        (capture / "capture.json").write_text(json.dumps({"generator": {"world": {"origin": world}}}))
        assert geographic_origin(loaded) == expected
    (capture / "capture.json").write_text(json.dumps({"generator": {"world": {"origin": origin}}}))
    clip = Clip(loaded, path_of_frames(loaded, "held-out"), None)
    export(clip, "ply", tmp_path / "ply", silent)
    comments = PlyData.read(str(tmp_path / "ply/clip_000000.ply")).comments
    assert json.loads(comments[1].removeprefix("geographic origin ")) == origin
    (capture / "capture.json").unlink()
    assert geographic_origin(loaded) is None
    export(clip, "ply", tmp_path / "ply", silent)  # goes on all the same


def test_another_export_or_folder_is_not_written_into(clip: Clip, tmp_path: Path) -> None:
    export(clip, "points", tmp_path / "out", silent)
    with pytest.raises(InputError, match="holds an export with other settings"):
        export(clip, "ply", tmp_path / "out", silent)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/notes").touch()
    with pytest.raises(InputError, match="not empty and not an export"):
        export(clip, "ply", tmp_path / "mine", silent)


@pytest.mark.parametrize("name", [name for name, exporter in EXPORTERS.items() if exporter.states_axes])
def test_a_format_that_states_its_axes_has_no_choice(clip: Clip, tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="states its axes"):
        export(replace(clip, axes="viewer"), name, tmp_path / "out", silent)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("name", "module"), [("4dgs", "fourdgs"), ("usd", "pxr"), ("usd-points", "pxr")])
def test_a_missing_package_is_named(
    clip: Clip, tmp_path: Path, name: str, module: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputError, match=f"--format {name}: needs the package"):
        export(clip, name, tmp_path / "out", silent)
    assert not (tmp_path / "out").exists()


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


def test_the_model_file_alone_is_enough(toy_run: Path, tmp_path: Path) -> None:
    alone = tmp_path / "model.safetensors"
    shutil.copyfile(toy_run / "model.safetensors", alone)
    loaded = load_model(alone)
    assert loaded.capture_folder is not None
    assert not loaded.capture_folder.exists()
    export(Clip(loaded, path_of_frames(loaded, "held-out"), None), "points", tmp_path / "out", silent)
    assert (tmp_path / "out/000008.ply").exists()
