"""Clips whose frame rate is not the scene's keep their seconds, and scenes that play something keep their rate."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driving import attribute, clip_positions, go_to, imported, played
from model_files import make_model, write_model
from PIL import Image

FRAMES = 5


def a_clip(folder: Path, fps: float, groups: int = 0) -> Path:
    """A model of this rate, with its capture's frames beside it."""
    capture = folder / "capture"
    (capture / "frames").mkdir(parents=True)
    (capture / "capture.json").write_text(json.dumps({"format": "aa4d-capture"}))
    tensors, information = make_model(60, FRAMES, groups=groups)
    for rank, frame in enumerate(information["frames"]):
        frame["time_s"] = rank / fps
        Image.new("RGB", (32, 18)).save(capture / frame["image"])
    information["fps"], information["capture"] = fps, "capture"
    return write_model(folder / "model.safetensors", tensors, information)


def rate_of(scene: Any) -> float:
    return scene.render.fps / scene.render.fps_base


@pytest.mark.parametrize("baked", [False, True])
@pytest.mark.parametrize(("rate", "fps"), [(24, 12.0), (24, 48.0), (25, 29.97)])
def test_clip_keeps_its_seconds(bpy: Any, tmp_path: Path, rate: int, fps: float, baked: bool) -> None:
    """Points, camera, handles and footage: all at the instant that the scene's seconds say."""
    path = a_clip(tmp_path, fps, groups=3)
    scene = bpy.context.scene
    obj = imported(bpy, path)
    assert rate_of(scene) == pytest.approx(fps)
    camera = next(o for o in scene.objects if o.type == "CAMERA")
    handle = scene.objects["car 1 Handle"]
    instants = [0.0, 1.0, 3.0, 4.0]  # of the clip's frames
    places = clip_positions(bpy, obj, instants)
    views, cars = [], []
    for instant in instants:
        go_to(bpy, 1 + instant)
        views.append(np.array(camera.matrix_world))
        cars.append(np.array(handle.matrix_world))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    scene.render.fps, scene.render.fps_base = rate, 1
    obj = imported(bpy, path, set_timeline=False, bake=baked)
    assert rate_of(scene) == rate
    camera = next(o for o in scene.objects if o.type == "CAMERA")
    handle = scene.objects["car 1 Handle"]
    for instant, place, view, car in zip(instants, places, views, cars, strict=True):
        go_to(bpy, 1 + instant / fps * rate)
        np.testing.assert_allclose(played(bpy, obj)["position"], place, atol=2e-3)
        np.testing.assert_allclose(camera.matrix_world, view, atol=1e-3)
        np.testing.assert_allclose(handle.matrix_world, car, atol=1e-3)
    seconds = (FRAMES - 1) / fps
    for frame in range(-1, 2 + int(seconds * rate) + 3):
        go_to(bpy, frame)
        user = camera.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.background_images[0].image_user
        shown = min(max(frame - user.frame_start + 1, 1), user.frame_duration) + user.frame_offset
        assert shown == min(max(int((frame - 1) / rate * fps + 1e-3), 0), FRAMES - 1)


def test_second_import_keeps_the_rate_of_the_first(bpy: Any, tmp_path: Path) -> None:
    slow, fast = a_clip(tmp_path / "slow", 12), a_clip(tmp_path / "fast", 24)
    first = imported(bpy, fast)
    scene = bpy.context.scene
    assert (rate_of(scene), scene.frame_start, scene.frame_end) == (24, 1, FRAMES)
    expected = clip_positions(bpy, first, [0, 2])
    second = imported(bpy, slow)
    assert (rate_of(scene), scene.frame_start, scene.frame_end) == (24, 1, 9)  # four frames of twice the length
    for rank, places in zip((0, 2), expected, strict=True):
        go_to(bpy, 1 + rank)
        np.testing.assert_array_equal(attribute(first.data, "position"), places)
        go_to(bpy, 1 + 2 * rank)
        np.testing.assert_allclose(attribute(second.data, "position"), places, atol=1e-3)


def test_rate_of_a_scene_with_animation_stays(bpy: Any, tmp_path: Path) -> None:
    scene = bpy.context.scene
    scene.render.fps, scene.frame_end = 30, 100
    ball = bpy.data.objects.new("ball", None)
    scene.collection.objects.link(ball)
    ball.keyframe_insert("location", frame=1)
    width = scene.render.resolution_x
    imported(bpy, a_clip(tmp_path, 12))
    assert (rate_of(scene), scene.frame_end, scene.render.resolution_x) == (30, 100, width)


def test_relinked_clip_of_another_rate_keeps_its_seconds(bpy: Any, tmp_path: Path) -> None:
    obj = imported(bpy, a_clip(tmp_path / "fast", 24))
    expected = clip_positions(bpy, obj, [0, 2])
    assert bpy.ops.aa4d.relink(filepath=str(a_clip(tmp_path / "slow", 12))) == {"FINISHED"}
    for rank, places in zip((0, 2), expected, strict=True):
        go_to(bpy, 1 + 2 * rank)
        np.testing.assert_allclose(attribute(obj.data, "position"), places, atol=1e-3)
