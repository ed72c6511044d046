"""Clips whose frames are not evenly apart play by their seconds: points, camera, handles, footage, speed."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driving import clip_positions, go_to, imported, played
from model_files import make_model, write_model
from PIL import Image

from addon.carriers import mean_speed
from addon.clip import Clip, read_clip

SECONDS = [0.0, 1.0, 2.0, 3.0, 4.0, 10.0, 11.0, 12.0]


def information_of(seconds: list[float], fps: float = 1.0, groups: int = 0) -> tuple[dict[str, np.ndarray], dict]:
    tensors, information = make_model(60, len(seconds), groups=groups)
    for frame, second in zip(information["frames"], seconds, strict=True):
        frame["time_s"] = second
    information["fps"] = fps
    return tensors, information


def clip_of(seconds: list[float], fps: float = 1.0) -> Clip:
    return read_clip(Path("model.safetensors"), information_of(seconds, fps)[1])


def a_model(folder: Path, seconds: list[float], groups: int = 0) -> Path:
    """With its capture's frames beside it."""
    (folder / "capture/frames").mkdir(parents=True)
    (folder / "capture/capture.json").write_text(json.dumps({"format": "aa4d-capture"}))
    tensors, information = information_of(seconds, groups=groups)
    for frame in information["frames"]:
        Image.new("RGB", (32, 18)).save(folder / "capture" / frame["image"])
    information["capture"] = "capture"
    return write_model(folder / "model.safetensors", tensors, information)


def test_second_four_is_the_fifth_frame_and_second_seven_lies_midway_to_the_sixth() -> None:
    clip = clip_of(SECONDS)
    assert (clip.frame_count, clip.is_even) == (13, False)
    assert [clip.time_of_rank(rank) * 7 for rank in (0, 4, 7, 10, 12, -1, 99)] == pytest.approx([0, 4, 4.5, 5, 7, 0, 7])
    assert clip.seconds_between(4 / 7, 5 / 7) == pytest.approx(6)
    np.testing.assert_allclose(clip.camera_center_at(5 / 7), clip.camera_centers[5])


def test_a_clip_that_is_even_but_for_rounding_keeps_every_bit() -> None:
    clip = clip_of([round(i / 29.97, 3) for i in range(40)], 29.97)
    assert (clip.frame_count, clip.is_even) == (40, True)
    assert all(clip.time_of_rank(rank) == rank / 39 for rank in np.arange(0, 39.01, 0.25))


@pytest.mark.parametrize(("seconds", "fps", "frames"), [([0, 0.5, 1.0], 24, 25), ([0, 1 / 24, 2.5 / 24], 24, 4)])
def test_the_clock_is_that_of_the_rate(seconds: list[float], fps: float, frames: int) -> None:
    """Every twelfth frame kept; a frame between two of the clock."""
    assert clip_of(seconds, fps).frame_count == frames


def test_a_clip_of_one_frame_and_one_without_end() -> None:
    assert (clip_of([3.0]).time_of_rank(7), clip_of([3.0]).is_even) == (0, True)
    with pytest.raises(ValueError, match="time_s must span fewer than 1,000,000 frames"):
        clip_of([0.0, 1e7])


def test_speed_is_a_second_of_the_clip() -> None:
    """What moves by one between frames 4 and 5 takes six seconds for it."""
    clip = clip_of(SECONDS)
    speed = mean_speed(clip, 4.5 / 7, lambda t: np.array([[7 * t, 0, 0]], np.float32))
    assert speed[0] == pytest.approx(1 / 6, rel=1e-4)


@pytest.mark.parametrize("baked", [False, True])
def test_everything_plays_by_the_seconds(bpy: Any, tmp_path: Path, baked: bool) -> None:
    even = imported(bpy, a_model(tmp_path / "even", [float(rank) for rank in range(8)], groups=3))
    expected = clip_positions(bpy, even, list(range(8)))
    handle = bpy.context.scene.objects["car 1 Handle"]
    cars = []
    for rank in range(8):
        go_to(bpy, 1 + rank)
        cars.append(np.array(handle.matrix_world))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    path = a_model(tmp_path / "uneven", SECONDS, groups=3)
    obj = imported(bpy, path, bake=baked)
    scene = bpy.context.scene
    assert (scene.frame_start, scene.frame_end, scene.render.fps / scene.render.fps_base) == (1, 13, 1)
    camera = next(o for o in scene.objects if o.type == "CAMERA")
    handle = scene.objects["car 1 Handle"]
    centers = read_clip(path, information_of(SECONDS)[1]).camera_centers
    for rank, second in enumerate(SECONDS):
        go_to(bpy, 1 + second)
        np.testing.assert_allclose(played(bpy, obj)["position"], expected[rank], atol=2e-3)
        np.testing.assert_allclose(camera.matrix_world.translation, centers[rank], atol=1e-3)
        np.testing.assert_allclose(handle.matrix_world, cars[rank], atol=1e-3)
    for frame in range(1, 14):
        go_to(bpy, frame)
        user = camera.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.background_images[0].image_user
        shown = min(max(frame - user.frame_start + 1, 1), user.frame_duration) + user.frame_offset
        assert shown == sum(second <= frame - 1 for second in SECONDS) - 1
