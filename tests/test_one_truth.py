"""What synth, aa4d and the extension each have a copy of, since none imports another: the copies are equal."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

import aa4d.capture.writing
import aa4d.evaluation.activity
import aa4d.export.clip
import aa4d.export.splat_ply
import aa4d.export.usd_points
import aa4d.files
import aa4d.kernels.plane_lookup
import aa4d.methods.adaanchor4d.files
import aa4d.methods.model_file
import addon.activity
import addon.carriers
import addon.groups
import addon.header
import addon.model
import addon.splat_ply
import synth.camera
import synth.develop
import synth.export.nerfstudio
import synth.files
import synth.flight.keys
import synth.plan
import synth.traffic.tracks
import synth.truth.activity
from aa4d.capture import schema
from aa4d.capture.schema import PinholeCamera
from aa4d.capture.sources.transforms import read_transforms
from aa4d.methods.adaanchor4d.aggregations import AGGREGATIONS
from aa4d.motion.spline import FEWEST_CONTROLS
from synth.spec import Scene, Time, read_scene

ROOT = Path(__file__).resolve().parent.parent


def test_names_are_the_same() -> None:
    assert synth.truth.activity.LABELS == aa4d.evaluation.activity.CLASSES == addon.activity.LABELS
    assert aa4d.kernels.plane_lookup.PLANES == addon.model.PLANES
    assert set(AGGREGATIONS) == set(addon.model.AGGREGATIONS)
    assert synth.files.TEMPORARY_SUFFIX == aa4d.files.UNFINISHED == ".part"
    assert aa4d.methods.DEFAULT == addon.model.METHOD


def test_limits_are_the_same() -> None:
    assert schema.FARTHEST_M == synth.flight.keys.WORLD_M == synth.traffic.tracks.FARTHEST_M == addon.header.FARTHEST_M
    assert aa4d.methods.model_file.FARTHEST_MODEL_M == addon.header.FARTHEST_MODEL_M
    assert (schema.MAX_SIDE_PX, schema.MAX_FOCAL_PX) == (addon.header.MOST_PX, addon.header.LARGEST_K)
    assert schema.MAX_FPS == addon.header.FASTEST_FPS
    assert schema.MAX_NAME_BYTES == aa4d.methods.model_file.LONGEST_NAME == addon.model.LONGEST_NAME
    assert aa4d.methods.adaanchor4d.files.LARGEST_SIZE == addon.model.WIDEST
    assert aa4d.methods.adaanchor4d.files.UNIFORM_TOLERANCE == addon.model.UNIFORM_TOLERANCE
    assert FEWEST_CONTROLS == addon.groups.FEWEST_CONTROLS
    assert aa4d.export.clip.FAINTEST == addon.splat_ply.FAINTEST
    assert aa4d.capture.writing.HELD_OUT_EVERY == synth.plan.TEST_EVERY


def test_what_synth_renders_is_within_what_aa4d_reads() -> None:
    def largest(declared: type, name: str) -> float:
        fields = {field.name: field for field in dataclasses.fields(declared)}
        return float(fields[name].metadata["range"][1])

    assert max(largest(synth.camera.Camera, side) for side in ("width_px", "height_px")) <= schema.MAX_SIDE_PX
    assert largest(Time, "fps") <= schema.MAX_FPS


def test_the_curve_of_srgb_is_one() -> None:
    linear = np.concatenate([np.linspace(0, 0.01, 400), np.linspace(0.01, 1, 800)])
    curve = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    np.testing.assert_allclose(addon.splat_ply.srgb(linear), curve, atol=1e-7)
    np.testing.assert_array_equal(synth.develop.srgb_from_linear(linear.astype(np.float32)), np.round(255 * curve))
    np.testing.assert_allclose(aa4d.export.usd_points.linear(curve), linear, atol=1e-7)
    rgba = addon.carriers.linear_rgba(np.repeat(curve[:, None], 3, axis=1).astype(np.float32))
    np.testing.assert_allclose(rgba, np.column_stack([linear] * 3 + [np.ones(1200)]), atol=1e-6)


def test_both_write_the_same_splats(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    means, scales, colors = random.normal(size=(50, 3)), random.uniform(0, 2, (50, 3)), random.uniform(0, 1, (50, 3))
    quaternions, opacities = random.normal(size=(50, 4)), random.uniform(1 / 255, 1, 50)
    scales[0], opacities[:3] = 0, [1 / 255, 1, 1 - 1e-9]
    drawn = aa4d.export.clip.WorldGaussians(np.arange(50), means, quaternions, scales, opacities, colors)
    aa4d.export.splat_ply.write_splat_ply(tmp_path / "a.ply", drawn)
    fainter = np.append(opacities, [0.0, 0.0039])  # aa4d leaves those out of a clip, the extension as it writes

    def and_two(values: np.ndarray) -> np.ndarray:
        return np.concatenate([values, values[:2]])

    addon.splat_ply.write_ply(
        tmp_path / "b.ply", and_two(means), and_two(colors), fainter, and_two(scales), and_two(quaternions)
    )
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()


@pytest.fixture(scope="module")
def scene() -> Scene:
    return read_scene(ROOT / "scenes" / "tiny.toml")


def test_both_write_the_same_transforms(scene: Scene, tmp_path: Path) -> None:
    plan = synth.plan.make_plan(scene)
    theirs = synth.export.nerfstudio.transforms(plan)
    camera = PinholeCamera(scene.camera.width_px, scene.camera.height_px, plan.K)
    frames = [
        {"image": f"frames/{f.name}.png", "t": f.t, "split": f.split, "viewmat": f.viewmat.tolist()}
        for f in plan.frames
    ]
    ours = aa4d.capture.writing.transforms(camera, frames)
    for frame, other in zip(ours["frames"], theirs["frames"], strict=True):
        np.testing.assert_allclose(frame.pop("transform_matrix"), other.pop("transform_matrix"), atol=1e-12)
    assert json.dumps(ours) == json.dumps(theirs)
    (tmp_path / "transforms.json").write_text(json.dumps(aa4d.capture.writing.transforms(camera, frames)))
    model = read_transforms(tmp_path / "transforms.json").model
    poses = [model.image(i).cam_from_world().matrix() for i in sorted(model.reg_image_ids())]
    np.testing.assert_allclose(poses, [frame.viewmat[:3] for frame in plan.frames], atol=1e-9)
