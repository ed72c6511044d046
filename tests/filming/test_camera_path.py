"""Camera paths: frames, files, resampling, frozen time and frozen camera."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aa4d.errors import InputError
from aa4d.filming.camera_path import (
    CameraPath,
    View,
    at_rate,
    instant_path,
    looking_at,
    named_path,
    only_time,
    path_of_frames,
    read_camera_path,
    resampled,
    with_camera,
    with_time,
)
from aa4d.methods.model_file import LoadedModel, load_model
from tests.toy_capture import viewmat


@pytest.fixture(scope="module")
def loaded(toy_run: Path) -> LoadedModel:
    return load_model(toy_run / "model.safetensors")


def write(path: Path, **changes: Any) -> Path:
    document = {
        "format": "aa4d-camera-path",
        "version": 1,
        "fps": 12,
        "views": [
            {"t": 0.0, "viewmat": viewmat(np.array([0.0, 0, 20])).tolist()},
            {"t": 0.5, "position_m": [-20, 0, 20], "look_at_m": [0, 0, 0], "name": "aside"},
        ],
    }
    path.write_text(json.dumps(document | changes))
    return path


def test_frames_of_a_split_last_as_long_as_the_clip(loaded: LoadedModel) -> None:
    every, held_out = path_of_frames(loaded, "all"), path_of_frames(loaded, "held-out")
    assert [v.name for v in held_out.views] == ["000000", "000008"]
    assert every.fps == pytest.approx(10)
    assert (len(held_out.views) - 1) / held_out.fps == pytest.approx(0.8)
    assert len(path_of_frames(loaded, "training").views) == 8


def test_a_path_file_says_where_and_when(loaded: LoadedModel, tmp_path: Path) -> None:
    path = read_camera_path(write(tmp_path / "path.json"), loaded)
    assert [(v.name, v.t) for v in path.views] == [("000000", 0.0), ("aside", 0.5)]
    assert path.views[0].center() == pytest.approx([0, 0, 20])
    assert path.views[1].center() == pytest.approx([-20, 0, 20])
    assert path.camera.width == loaded.camera.width
    own = {"model": "PINHOLE", "width": 64, "height": 36, "K": [[50, 0, 32], [0, 50, 18], [0, 0, 1]]}
    assert read_camera_path(write(tmp_path / "path.json", camera=own), loaded).camera.width == 64


@pytest.mark.parametrize("target", [[0, 0, 0], [3, 4, -5], [10, 7, 12]])
def test_looking_at_puts_the_target_ahead_and_the_sky_up(target: list[float]) -> None:
    eye = np.array([10.0, 7, 12])
    if target == eye.tolist():
        target = [10, 7, 0]  # straight down
    pose = looking_at(eye, np.array(target, float))
    x, y, z = pose[:3, :3] @ np.array(target) + pose[:3, 3]
    assert (x, y) == pytest.approx((0, 0), abs=1e-9)
    assert z == pytest.approx(float(np.linalg.norm(eye - target)))
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
    up = [0, 1, 0] if target[:2] == [10, 7] else [0, 0, 1]
    assert (pose[:3, :3] @ up)[1] < 0  # image y runs down
    assert (pose[:3, :3] @ up)[0] == pytest.approx(0, abs=1e-9)


def arc(n: int) -> CameraPath:
    views = []
    for i in range(n):
        angle = 2.0 * i / (n - 1)
        eye = 30.0 * np.array([math.cos(angle), math.sin(angle), 1.0])
        views.append(View(f"{i:06}", i / (n - 1), looking_at(eye, np.zeros(3))))
    camera = None
    return CameraPath(tuple(views), np.arange(n) / 10, camera, 10.0)


def test_resampling_passes_through_every_view_and_keeps_to_the_arc() -> None:
    path = arc(9)
    fine = resampled(path, 33)
    for i, view in enumerate(path.views):
        np.testing.assert_allclose(fine.views[4 * i].viewmat, view.viewmat, atol=1e-9)
        assert fine.views[4 * i].t == pytest.approx(view.t)
    for view in fine.views:
        rotation = view.viewmat[:3, :3]
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        assert np.hypot(*view.center()[:2]) == pytest.approx(30, abs=0.01)
        # It goes on looking at the middle.
        x, y, z = view.viewmat[:3, 3]
        assert abs(x / z) < 1e-3
        assert abs(y / z) < 1e-3
    assert (len(fine.views) - 1) / fine.fps == pytest.approx((len(path.views) - 1) / path.fps)


def test_another_frame_rate_keeps_the_seconds() -> None:
    path = at_rate(arc(9), 25)
    assert len(path.views) == 21
    assert path.fps == 25
    assert path.views[-1].t == 1


SECONDS = [5.0, 6.0, 7.0, 8.0, 9.0, 15.0, 16.0, 17.0, 17.5, 20.0]  # a film of which frames were left out


def uneven(loaded: LoadedModel) -> LoadedModel:
    return replace(loaded, frames=tuple(replace(f, time_s=s) for f, s in zip(loaded.frames, SECONDS, strict=True)))


def test_each_frame_is_shown_at_its_own_second(loaded: LoadedModel) -> None:
    path = path_of_frames(uneven(loaded), "all")
    assert path.at.tolist() == [s - 5 for s in SECONDS]
    assert path.fps == pytest.approx(9 / 15)
    assert path.as_json()["seconds"] == path.at.tolist()
    every_half = at_rate(path, 2)
    assert len(every_half.views) == 31
    for second, frame in ((0, 0), (4, 4), (10, 5), (12.5, 8), (15, 9)):
        view = every_half.views[int(2 * second)]
        assert view.t == pytest.approx(loaded.frames[frame].t)
        np.testing.assert_allclose(view.viewmat, loaded.frames[frame].viewmat, atol=1e-9)
    # Half-way through the gap of six seconds, half-way between its two frames.
    assert every_half.views[14].t == pytest.approx((loaded.frames[4].t + loaded.frames[5].t) / 2)
    assert "seconds" not in path_of_frames(loaded, "all").as_json()


def test_seconds_of_a_model_are_those_of_its_frames(loaded: LoadedModel) -> None:
    film = uneven(loaded)
    assert [film.seconds_at(frame.t) for frame in film.frames] == pytest.approx(SECONDS)
    assert film.seconds_at((loaded.frames[4].t + loaded.frames[5].t) / 2) == pytest.approx(12)


@pytest.mark.parametrize("views", [1, 2, 3])
def test_a_hovering_camera_stays_where_it_is(views: int) -> None:
    still = viewmat(np.array([1.0, 2, 20]))
    path = CameraPath(
        tuple(View(str(i), i / 3, still) for i in range(views)), np.arange(views) / 10, None, 10.0
    )  # fmt: skip
    for view in resampled(path, 7).views:
        np.testing.assert_allclose(view.viewmat, still, atol=1e-9)
        assert 0 <= view.t <= 1


def test_time_and_camera_are_independent(loaded: LoadedModel) -> None:
    path = path_of_frames(loaded, "all")
    frozen = with_time(path, 0.25)
    assert {v.t for v in frozen.views} == {0.25}
    assert all(np.array_equal(a.viewmat, b.viewmat) for a, b in zip(frozen.views, path.views, strict=True))
    tripod = with_camera(path, path.views[3].viewmat)
    assert [v.t for v in tripod.views] == [v.t for v in path.views]
    assert all(np.array_equal(v.viewmat, path.views[3].viewmat) for v in tripod.views)
    only = only_time(path, 0.3)
    assert len(only.views) == 1
    assert only.views[0].t == 0.3
    assert np.array_equal(only.views[0].viewmat, path.views[3].viewmat)


def test_a_path_is_named_after_what_it_shows(loaded: LoadedModel, tmp_path: Path) -> None:
    assert named_path(loaded, "all", None, None, None, None, None)[1] == "all"
    path, name = named_path(loaded, "all", None, 5, None, 0.5, "000003")
    assert name == "all-5-t0.5-from-000003"
    assert len(path.views) == 5
    assert named_path(loaded, "all", write(tmp_path / "turn.json"), None, 24, None, None)[1] == "turn-24fps"


VIEW = {"t": 0.0, "viewmat": np.eye(4).tolist()}


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"format": "other"}, 'key "format"'),
        ({"version": 2}, "version 2 is not known"),
        ({"fps": 0}, '"fps" must be positive'),
        ({"fps": float("nan")}, "finite number"),
        ({"views": []}, '"views" is missing or empty'),
        ({"views": [3]}, "view 0 is not an object"),
        ({"views": [VIEW | {"t": 1.5}]}, r"must be a number from 0 to 1, the time of the clip, not 1.5"),
        ({"views": [VIEW | {"t": float("nan")}]}, "must be a finite number"),
        ({"views": [VIEW | {"viewmat": np.full((4, 4), np.nan).tolist()}]}, "holds NaN or infinity"),
        ({"views": [VIEW | {"viewmat": (2 * np.eye(4)).tolist()}]}, "not a rotation and a translation"),
        ({"views": [VIEW | {"viewmat": [[1, 2], [3, 4]]}]}, "has shape"),
        ({"views": [VIEW | {"fov": 60}]}, "unknown key 'fov'"),
        ({"loop": True}, "the path has an unknown key 'loop'; known are camera, format, fps"),
        ({"views": [VIEW | {"look_at_m": [0, 0, 0]}]}, "needs either viewmat, or position_m"),
        ({"views": [{"t": 0.0, "look_at_m": [0, 0, 0]}]}, "position_m of view"),
        ({"views": [VIEW | {"name": "../../x"}]}, "no plain file name"),
        ({"views": [VIEW | {"name": "a"}, VIEW | {"name": "a"}]}, "same name"),
        ({"views": [{"t": 0.0}]}, "needs either viewmat, or position_m"),
        ({"views": [{"t": 0.0, "position_m": [0, 0, 1]}]}, "look_at_m of view"),
        ({"views": [{"t": 0.0, "position_m": [0, 0, 1], "look_at_m": [0, 0, 1]}]}, "looks at where it stands"),
        ({"views": [{"t": 0.0, "position_m": [0, 0, 1e6], "look_at_m": [0, 0, 1]}]}, "over 10000 m"),
        ({"camera": {"model": "FISHEYE"}}, "not supported"),
    ],
)
def test_bad_paths_are_refused(loaded: LoadedModel, tmp_path: Path, changes: dict[str, Any], says: str) -> None:
    file = write(tmp_path / "path.json", **changes)
    with pytest.raises(InputError, match=says) as error:
        read_camera_path(file, loaded)
    assert str(file) in str(error.value)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ((None, 0, None, None, None), "0 views: must be at least 1"),
        ((None, 10**8, None, None, None), "100000000 views: must be at least 1 and at most 100000"),
        ((None, None, -1.0, None, None), "--fps -1"),
        ((None, None, math.nan, None, None), "--fps nan"),
        ((None, 3, 3.0, None, None), "give one of them"),
        ((None, None, None, math.nan, None), "--time must be a number from 0 to 1, the time of the clip, not nan"),
        ((None, None, None, -0.1, None), r"--time must be a number from 0 to 1, the time of the clip, not -0.1"),
        ((None, None, None, None, "absent"), "has no frame 'absent'; they run from '000000' to '000009'"),
        ((Path("absent.json"), None, None, None, None), "not found"),
    ],
)
def test_bad_options_are_refused(loaded: LoadedModel, options: tuple[Any, ...], says: str) -> None:
    with pytest.raises(InputError, match=says):
        named_path(loaded, "all", *options)


def test_frames_of_the_capture_cannot_be_chosen_of_a_path(loaded: LoadedModel, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--views held-out: chooses frames of the capture, and --path flies past them"):
        named_path(loaded, "held-out", write(tmp_path / "path.json"), None, None, None, None)


def test_frozen_time_seen_from_a_frozen_camera_is_one_picture(loaded: LoadedModel) -> None:
    path, name = named_path(loaded, "all", None, None, None, 0.5, "000003")
    assert (name, len(path.views), path.views[0].t) == ("all-t0.5-from-000003", 1, 0.5)
    assert np.array_equal(path.views[0].viewmat, loaded.frames[3].viewmat)


def test_an_instant_is_one_view(loaded: LoadedModel) -> None:
    path, name = instant_path(loaded, "held-out", None, None, None, 0.5)
    assert (name, [view.t for view in path.views]) == ("t0.5", [0.5])
    assert instant_path(loaded, "all", None, 3, None, None)[1] == "all-3"
    with pytest.raises(InputError, match="--time writes one instant, and --frames resamples many"):
        instant_path(loaded, "all", None, 3, None, 0.5)
    with pytest.raises(InputError, match="--time writes one instant, and --fps resamples many"):
        instant_path(loaded, "all", None, None, 3.0, 0.5)
