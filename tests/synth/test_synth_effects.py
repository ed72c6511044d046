"""Effects: each does what it says in closed form, and the ones that nobody names are not there."""

import importlib.util
import math
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from synth.band_limited import band_limited
from synth.camera import intrinsics, invert_rigid
from synth.effects import (
    NAMES,
    STAGES,
    burned_in_text,
    choose,
    cloud_shadow,
    haze,
    lens_distortion,
    sensor_noise,
    vignetting,
)
from synth.errors import InputError
from synth.plan import Plan, make_plan
from synth.rotations import rotation
from synth.shutter import Shutter
from synth.spec import Camera, Scene, read_scene

Command = Callable[[Sequence[object]], "subprocess.CompletedProcess[str]"]
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def scene(tiny_scene: Path) -> Scene:
    return read_scene(tiny_scene)


def planned(scene: Scene, **tables: dict[str, Any]) -> Plan:
    return make_plan(replace(scene, effects=tables))


def test_every_effect_says_what_it_is() -> None:
    folder = ROOT / "synth" / "effects"
    assert {path.stem for path in folder.glob("*.py")} == {"__init__", *NAMES}
    for effect in choose({name: {} for name in NAMES}, "x"):
        assert effect.stage in STAGES
        assert effect.module.COST
        assert effect.module.TRUTH


def test_unknown_effects_and_settings_are_refused() -> None:
    with pytest.raises(InputError, match=r"s.toml: effects.motion_blurr: unknown effect; did you mean 'motion_blur'"):
        choose({"motion_blurr": {}}, "s.toml")
    with pytest.raises(InputError, match=r"s.toml: effects.vignetting.corner_stops: 9 is out of range"):
        choose({"vignetting": {"corner_stops": 9}}, "s.toml")


def test_an_effect_that_no_scene_names_is_not_imported(tiny_scene: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from synth.plan import make_plan; from synth.spec import read_scene;"
        f"make_plan(read_scene(Path({str(tiny_scene)!r})));"
        "print([name for name in sys.modules if name.startswith('synth.effects.')])"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, timeout=60, check=True)
    assert ran.stdout.strip() == "[]"


def test_capture_is_the_same_with_the_effects_deleted(capture: Path, tiny_scene: Path, tmp_path: Path) -> None:
    """The whole generator without a single effect's file writes the same bytes, and its log names none of them."""
    shutil.copytree(ROOT / "synth", tmp_path / "synth", ignore=shutil.ignore_patterns("__pycache__"))
    for name in NAMES:
        (tmp_path / "synth" / "effects" / f"{name}.py").unlink()
    out = tmp_path / "out"
    command = [sys.executable, str(tmp_path / "synth" / "render_flyover.py"), str(tiny_scene), "--out", str(out)]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=240, check=False)
    assert ran.returncode == 0, ran.stderr
    assert not [name for name in NAMES if name in ran.stdout + ran.stderr]
    assert (out / "checksums.json").read_bytes() == (capture / "checksums.json").read_bytes()
    assert (out / "capture.json").read_bytes() == (capture / "capture.json").read_bytes()
    scene = tmp_path / "hazy.toml"
    scene.write_text(tiny_scene.read_text() + "\n[effects.haze]\n")
    command[2:] = [str(scene), "--out", str(tmp_path / "hazy")]
    refused = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert refused.returncode == 2
    assert "synth/effects/haze.py is not installed" in refused.stderr


def test_band_limited_motion_has_its_rms_and_its_band() -> None:
    noise = band_limited(np.random.default_rng(0), 8, 0.3, (0.5, 2.0))
    times = np.arange(0, 400, 0.05)
    values = np.stack([noise(float(t)) for t in times])
    assert np.sqrt((values**2).mean()) == pytest.approx(0.3, rel=0.02)
    spectrum = np.abs(np.fft.rfft(values * np.hanning(len(times))[:, None], axis=0)) ** 2
    frequency = np.fft.rfftfreq(len(times), 0.05)
    inside = (frequency > 0.45) & (frequency < 2.05)
    assert spectrum[inside].sum() > 0.999 * spectrum.sum()


def test_jitter_and_sway_are_continuous_between_frames(scene: Scene) -> None:
    plan = planned(scene, gimbal_jitter={}, position_sway={})
    still = planned(scene)
    times = np.linspace(0, 2.5, 500)
    poses = np.stack([plan.flight.camera_to_world(float(t)) for t in times])
    calm = np.stack([still.flight.camera_to_world(float(t)) for t in times])
    np.testing.assert_allclose(poses[:, :3, :3] @ np.swapaxes(poses[:, :3, :3], 1, 2) - np.eye(3), 0, atol=1e-12)
    off = poses[:, :3, 3] - calm[:, :3, 3]
    assert 0.02 < np.sqrt((off**2).mean()) < 0.3
    assert np.abs(np.diff(off, axis=0)).max() < 0.02  # of 0.1 m at half a hertz, in five milliseconds
    nearby = plan.flight.camera_to_world(1.0 + 1e-7) - plan.flight.camera_to_world(1.0)
    assert np.abs(nearby).max() < 1e-5
    for frame in plan.frames:
        np.testing.assert_array_equal(frame.viewmat, plan.flight.viewmat(frame.time_s))


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 1.0, math.pi])
def test_rotation_by_a_vector(angle: float) -> None:
    turned = rotation(np.array([0, 0, angle]))
    expected = [[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1]]
    np.testing.assert_allclose(turned, expected, atol=1e-15)


def test_measured_poses_scatter_as_asked_about_the_true_ones(scene: Scene) -> None:
    settings = {"horizontal_m": 0.5, "vertical_m": 1.0, "attitude_deg": 0.2, "correlation_s": 1.0}
    long = replace(scene, time=replace(scene.time, frames=2000))
    plan = planned(replace(long, vehicles=()), pose_noise=settings)
    from synth.export.index import measured_viewmats

    measured = measured_viewmats(plan)
    assert measured is not None
    off = np.stack([invert_rigid(m)[:3, 3] - invert_rigid(f.viewmat)[:3, 3] for m, f in zip(measured, plan.frames)])  # noqa: B905
    np.testing.assert_allclose(off.std(axis=0), [0.5, 0.5, 1.0], rtol=0.15)
    turned = [m[:3, :3] @ f.viewmat[:3, :3].T for m, f in zip(measured, plan.frames, strict=True)]
    angles = np.arccos(np.clip((np.trace(turned, axis1=1, axis2=2) - 1) / 2, -1, 1))
    assert np.degrees(np.sqrt((angles**2).mean())) == pytest.approx(0.2 * math.sqrt(3), rel=0.1)
    correlation = np.corrcoef(off[:-1, 0], off[1:, 0])[0, 1]
    assert correlation == pytest.approx(math.exp(-0.5), abs=0.08)  # half a second between frames


def test_several_effects_on_the_poses_that_are_told_add_up(scene: Scene) -> None:
    """The last one must not undo those before it."""
    from synth.effects import Effect
    from synth.export.index import measured_viewmats

    def shift(axis: int) -> Effect:
        def measure(metres: float, plan: Any) -> Any:
            return np.stack([f.viewmat + metres * np.eye(4)[:, 3:] @ np.eye(4)[axis : axis + 1] for f in plan.frames])

        return Effect(f"shift{axis}", 2.0 + axis, SimpleNamespace(STAGE="capture", measure=measure))  # type: ignore[arg-type]

    plan = planned(scene)
    both = measured_viewmats(replace(plan, effects=(shift(0), shift(1))))
    assert both is not None
    for frame, told in zip(plan.frames, both, strict=True):
        np.testing.assert_allclose((told - frame.viewmat)[3, :2], [2.0, 3.0])
    assert measured_viewmats(plan) is None


def test_shutter_rows_and_limits(scene: Scene) -> None:
    offsets = Shutter(readout_s=0.02).row_offsets_s(4)
    np.testing.assert_allclose(offsets, [-0.0075, -0.0025, 0.0025, 0.0075])
    both = planned(scene, motion_blur={"exposure_s": 0.5, "steps": 3}, rolling_shutter={"readout_s": 0.5, "steps": 2})
    assert both.shutter == Shutter(0.5, 0.5, 3)  # a whole frame each, at two frames per second
    for name, key in (("motion_blur", "exposure_s"), ("rolling_shutter", "readout_s")):
        assert planned(scene, **{name: {key: 0.0}}).shutter.instant
        with pytest.raises(InputError, match=f"effects.{name}.{key}: 0.51 is longer than a frame"):
            planned(scene, **{name: {key: 0.51}})
    with pytest.raises(InputError, match="rolling_shutter and lens_distortion together"):
        planned(scene, rolling_shutter={}, lens_distortion={})


def test_haze_is_koschmieders_law() -> None:
    linear = np.full((1, 3, 3), 0.1, dtype=np.float32)
    shot = SimpleNamespace(distance_m=lambda: np.array([[0.0, 500.0, np.inf]]))
    found = haze.expose(haze.Settings(visibility_m=500, colour=(0.5, 0.6, 0.7)), linear, shot)
    np.testing.assert_allclose(found[0, 0], 0.1, rtol=1e-6)
    np.testing.assert_allclose(found[0, 1], 0.02 * 0.1 + 0.98 * np.array([0.5, 0.6, 0.7]), rtol=1e-6)
    np.testing.assert_allclose(found[0, 2], [0.5, 0.6, 0.7], rtol=1e-6)


def test_vignetting_leaves_the_centre_and_halves_the_corner() -> None:
    found = vignetting.expose(vignetting.Settings(corner_stops=1.0), np.ones((201, 301, 3), np.float32), None)
    assert found[100, 150] == pytest.approx(1.0)
    assert found[0, 0] == pytest.approx(0.5, abs=0.01)


def test_sensor_noise_has_the_variance_of_shots_and_reading() -> None:
    settings = sensor_noise.Settings(full_well_e=1000, read_noise_e=5)
    shot = SimpleNamespace(seed=1, frame=SimpleNamespace(name="000000"))
    for level in (0.0, 0.2, 1.0):
        found = sensor_noise.expose(settings, np.full((300, 300, 3), level, np.float32), shot)
        assert found.mean() == pytest.approx(level, abs=2e-4)
        assert found.var() == pytest.approx(level / 1000 + (5 / 1000) ** 2, rel=0.02)
        np.testing.assert_array_equal(
            found, sensor_noise.expose(settings, np.full((300, 300, 3), level, np.float32), shot)
        )


def test_burned_in_text_is_black_and_white_where_the_mask_says_and_nowhere_else() -> None:
    gray = np.full((54, 96, 3), 0.5, np.float32)
    plan = SimpleNamespace(scene=SimpleNamespace(camera=SimpleNamespace(width_px=96, height_px=54)))

    def shot(split: str, time_s: float = 12.3) -> SimpleNamespace:
        return SimpleNamespace(frame=SimpleNamespace(split=split, time_s=time_s, viewmat=np.eye(4)))

    for share in (0.0, 0.13, 0.26, 0.5):
        settings = burned_in_text.Settings(height_share=share, held_out=False)
        burned = burned_in_text.expose(settings, gray, shot("train"))
        mask = burned_in_text.covers(settings, plan)
        assert mask[54 - round(share * 54) :, :10].all()
        np.testing.assert_array_equal((burned != gray).any(axis=-1), mask)
        assert set(np.unique(burned[mask])) == ({0.0, 1.0} if share else set())
        np.testing.assert_array_equal(burned_in_text.expose(settings, gray, shot("test")), gray)
    shown = burned_in_text.Settings(height_share=0.13)
    later = burned_in_text.expose(shown, gray, shot("test", time_s=12.4))
    assert (later != burned_in_text.expose(shown, gray, shot("test"))).any(), "the clock runs"
    assert (gray == 0.5).all()


LENSES = [{"k1": -0.25, "k2": 0.06, "p1": 0.002, "p2": -0.001}, {"k1": 0.1, "k3": 0.01}, {"k1": 0.0}]


@pytest.mark.parametrize("table", LENSES)
def test_lens_is_colmaps_and_inverts(table: dict[str, float]) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    camera = Camera(width_px=320, height_px=180, hfov_deg=66)
    settings = lens_distortion.Settings(**table)  # type: ignore[arg-type]
    lens = lens_distortion.lens(settings, intrinsics(camera), (320, 180))
    uv = np.random.default_rng(0).uniform([0, 0], [320, 180], size=(500, 2))
    rays = lens.rays(uv)
    np.testing.assert_allclose(lens.project(rays), uv, atol=1e-10)
    np.testing.assert_allclose(lens.project(7.5 * rays), uv, atol=1e-10)
    K = lens.K
    bent = [settings.k1, settings.k2, settings.p1, settings.p2, settings.k3, 0, 0, 0]
    other = pycolmap.Camera(
        model="FULL_OPENCV", width=320, height=180, params=[K[0, 0], K[1, 1], K[0, 2], K[1, 2], *bent]
    )
    np.testing.assert_allclose(other.img_from_cam(rays), uv, atol=1e-6)


def test_lens_that_folds_is_refused() -> None:
    K = intrinsics(Camera(width_px=320, height_px=180, hfov_deg=120))
    with pytest.raises(InputError, match=r"fold|twice as wide"):
        lens_distortion.lens(lens_distortion.Settings(k1=-0.9), K, (320, 180))


def test_pictures_through_a_lens_are_sampled_where_it_looks() -> None:
    """A wide picture that holds its own coordinates gives back where each pixel looks."""
    size = (64, 40)
    K = intrinsics(Camera(width_px=64, height_px=40, hfov_deg=60))
    lens = lens_distortion.lens(lens_distortion.Settings(k1=-0.2, p1=0.003), K, size)
    across, down = lens.margin_px
    x, y = np.meshgrid(np.arange(64 + 2 * across) + 0.5 - across, np.arange(40 + 2 * down) + 0.5 - down)
    wide = np.stack([x, y, np.ones_like(x)], axis=-1).astype(np.float32) + 100
    found = lens_distortion.picture(lens, wide, size) - 100
    i, j = np.meshgrid(np.arange(64) + 0.5, np.arange(40) + 0.5)
    expected = lens.rays(np.stack([i, j], axis=-1))[..., :2] * np.diag(K)[:2] + K[:2, 2]
    np.testing.assert_allclose(found[..., :2], expected, atol=2e-3)


def test_cloud_shadows_cover_what_is_asked_and_drift(scene: Scene) -> None:
    settings = cloud_shadow.Settings(cover=0.3, darkness=0.8, size_m=40, velocity_mps=(6.0, 2.0))
    clouds = cloud_shadow.Clouds(settings, scene.light, 5)
    assert (clouds.transmission < 0.6).mean() == pytest.approx(0.3, abs=0.05)
    assert clouds.transmission.min() == pytest.approx(0.2, abs=1e-9)
    points = np.random.default_rng(0).uniform(-50, 50, size=(200, 3)) * [1, 1, 0]
    moved = clouds.brightness(points + np.array([6.0, 2.0, 0]) * 1.7, 1.7)
    np.testing.assert_allclose(moved, clouds.brightness(points, 0.0), atol=1e-9)
    up = points + np.array([*(-25.0 * -clouds.per_height), 25.0])
    np.testing.assert_allclose(clouds.brightness(up, 0.3), clouds.brightness(points, 0.3), atol=1e-9)


def test_trees_in_the_wind_are_rigid_instances_with_the_speed_of_their_tops(scene: Scene) -> None:
    plan, calm = planned(scene, wind={}), planned(scene)
    trees = [m for m in plan.cast.members() if m.class_name == "tree"]
    assert len(trees) == sum(p.mesh.startswith("tree") for p in calm.city.placements) > 3
    assert not [p for p in plan.city.placements if p.mesh.startswith("tree")]
    poses = [plan.cast.object_to_world(t)[-len(trees) :] for t in (0.999, 1.001)]
    turned = poses[0][:, :3, :3]
    np.testing.assert_allclose(turned @ np.swapaxes(turned, 1, 2) - np.eye(3), 0, atol=1e-12)
    top = np.array([[0, 0, m.dimensions_m[2], 1] for m in trees])
    moved = np.linalg.norm(np.einsum("mij,mj->mi", poses[1] - poses[0], top), axis=1)
    np.testing.assert_allclose(moved / 0.002, plan.cast.speed_mps(1.0)[-len(trees) :], rtol=0.02, atol=1e-3)


def test_signal_lamps_follow_the_signal(scene: Scene) -> None:
    signal = replace(scene.signal, east_west_green_s=((0.0, 1.0),), north_south_green_s=((1.0, 9.0),))  # type: ignore[type-var]
    plan = planned(replace(scene, signal=signal), signal_lamps={})
    members = plan.cast.members()
    for time_s, green_along_x in ((0.5, True), (1.5, False)):
        lit, poses = plan.cast.lit(time_s), plan.cast.object_to_world(time_s)
        for m, member in enumerate(members):
            if member.class_name == "signal-lamp":
                along_x = abs(poses[m, 0, 0]) > 0.7
                assert lit[m] == (("green" in member.name) == (along_x == green_along_x))
    with pytest.raises(InputError, match=r"the scene has no \[signal\]"):
        planned(replace(scene, signal=None), signal_lamps={})


def test_indicators_blink_before_the_turn_and_brakes_light(scene: Scene) -> None:
    plan = planned(scene, indicator_lights={})
    names = [member.name for member in plan.cast.members() if member.class_name == "indicator"]
    assert any("east-north" in name and "turn-right" in name for name in names)
    assert not any("east-north" in name and "turn-left" in name for name in names)
    assert any("south-north" in name and "brake" in name for name in names)  # stops at the red light
    blinking = [m for m, member in enumerate(plan.cast.members()) if "turn-right" in member.name]
    states = np.array([[plan.cast.lit(t)[m] for m in blinking] for t in np.arange(0, 1.0, 0.05)])
    assert 2 <= np.abs(np.diff(states[:, 0].astype(int))).sum() <= 4  # 1.5 times a second


needs_bpy = pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs the bpy module")

ROWS = """
import os, sys
from dataclasses import replace
from pathlib import Path
import numpy as np
from synth.blender.film import Filming
from synth.blender.motion import animate
from synth.blender.passes import linear_rgb
from synth.blender.session import silence
from synth.capture import Folder
from synth.costs import Costs
from synth.plan import make_plan
from synth.shutter import Shutter
from synth.spec import read_scene
out = silence()
scratch = Path(sys.argv[2])
scene = replace(read_scene(Path(sys.argv[1])), effects={})
scene = replace(scene, render=replace(scene.render, samples=48))
def build(**effects):
    plan = make_plan(replace(scene, effects=effects))
    return Filming(plan, Folder(scratch), Costs(None), scratch)
def shoot(filming, frame):
    filming.place(frame)
    if not filming.plan.shutter.instant:
        animate(filming.plan, frame, filming.stage, filming.extras)
    return linear_rgb(filming.renderer.render_picture(7))
still = build()
frame = still.plan.frames[2]
def at(offset):
    time_s = frame.time_s + offset
    return shoot(still, replace(frame, time_s=time_s, viewmat=still.plan.flight.viewmat(time_s)))
rows, offsets = [2, 27, 51], Shutter(readout_s=0.1).row_offsets_s(54)
sharp, shifted = at(0.0), {r: at(offsets[r]) for r in rows}
mean = np.mean([at(s) for s in (np.arange(25) + 0.5) / 50 - 0.25], axis=0)
found = shoot(build(rolling_shutter={"readout_s": 0.1, "steps": 4}), frame)
exact = [np.abs(found[r] - shifted[r][r]).mean() for r in rows]
nominal = [np.abs(found[r] - sharp[r]).mean() for r in rows]
blurred = shoot(build(motion_blur={"exposure_s": 0.5, "steps": 4}), frame)
same = bool((shoot(build(motion_blur={"exposure_s": 0.0}), frame) == sharp).all())
blur = np.abs(blurred - mean).mean(), np.abs(sharp - mean).mean()
print("RESULT", *exact, *nominal, *blur, same, file=out, flush=True)
os._exit(0)
"""


@needs_bpy
@pytest.mark.slow
def test_rows_are_exposed_at_their_times_and_blur_is_the_mean(tiny_scene: Path, tmp_path: Path) -> None:
    """Rolling shutter: each row equals that row of a picture from the row's pose. Blur: the mean over the exposure."""
    command = [sys.executable, "-c", ROWS, str(tiny_scene), str(tmp_path)]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=280, cwd=ROOT, check=False)
    assert "RESULT" in ran.stdout, ran.stderr
    values = ran.stdout.split("RESULT")[1].split()
    top, middle, bottom, top_nominal, _, bottom_nominal, blur, sharp = map(float, values[:8])
    assert top < 0.35 * top_nominal
    assert bottom < 0.35 * bottom_nominal
    assert middle < 0.01
    assert blur < 0.5 * sharp
    assert values[8] == "True"  # an exposure of nothing is the picture without the effect


def test_plan_names_the_effects_and_their_settings(scene: Scene) -> None:
    from synth.explain import explain
    from synth.plan import document

    plan = planned(scene, haze={"visibility_m": 321})
    assert document(plan, "x")["effects"]["haze"]["visibility_m"] == 321
    said = explain(plan)
    assert "haze: visibility_m 321" in said
    assert "6 frames of 96x54" in said
    assert "effects  none" in explain(planned(scene))
