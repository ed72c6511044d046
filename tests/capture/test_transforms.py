"""Folders with nerfstudio's, D-NeRF's and this program's own cameras."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aa4d.capture.make import make_capture
from aa4d.capture.reader import read_capture
from aa4d.capture.settings import Selection
from aa4d.capture.sources import open_source
from aa4d.errors import InputError
from tests.capture import aerial
from tests.capture.given import SETTINGS, foreign, given, silent


def test_a_capture_keeps_its_world_its_metres_and_its_times(tmp_path: Path) -> None:
    """It has its cameras twice: nerfstudio's are in its world, COLMAP's would be turned and scaled anew."""
    source = given(tmp_path / "given", with_points=True)
    settings = replace(SETTINGS, selection=Selection(source_fps=77), movers="off")
    made = make_capture(source, tmp_path / "capture", settings, None, silent)
    capture = read_capture(made.folder)
    assert made.frames == 9
    assert made.world.unit == "metres"
    assert "transforms.json, whose world is kept; capture.json says that it is in metres" in made.world.scale_from
    assert "cameras are those of transforms.json; sparse/0 is not read" in made.notes
    assert "--fps 77 is ignored: capture.json says its own times" in made.notes
    assert capture.fps == pytest.approx(10)
    for frame, viewmat in zip(capture.frames, aerial.arc(), strict=True):
        assert np.allclose(frame.viewmat, viewmat, atol=1e-6)
    assert np.allclose(capture.camera.K, aerial.K)
    # Ground and roofs where they are.
    assert np.median(np.abs(capture.points[:, 2])) < 0.2
    assert np.percentile(capture.points[:, 2], 98) > 3


def test_cameras_of_an_unknown_unit_are_not_taken_for_metres(tmp_path: Path) -> None:
    source = given(tmp_path / "given", with_points=False)
    index = source / "capture.json"
    document = json.loads(index.read_text())
    document["generator"]["world"] = {"unit": "unit"}  # footage without satellite positions
    index.write_text(json.dumps(document))
    posed = open_source(source, Selection(), None).posed
    assert posed is not None
    assert not posed.is_metric
    index.unlink()
    opened = open_source(source, Selection(source_fps=20), None)
    assert opened.posed is not None
    assert not opened.posed.is_metric
    assert opened.times_s() == pytest.approx(np.arange(9) / 20)


def test_a_stated_field_of_view_for_cameras_that_have_theirs_is_refused(tmp_path: Path) -> None:
    source = given(tmp_path / "given", with_points=False)
    with pytest.raises(InputError, match="gives its cameras and their field of view; leave out --fov"):
        make_capture(source, tmp_path / "capture", replace(SETTINGS, fov_deg=50.0), None, silent)
    assert not (tmp_path / "capture").exists()


def test_transforms_of_any_editor_and_of_none(tmp_path: Path) -> None:
    source = given(tmp_path / "given", with_points=False)
    text = (source / "transforms.json").read_text()
    (source / "transforms.json").write_text(text, encoding="utf-8-sig")
    assert open_source(source, Selection(), None).posed is not None
    for nonsense in ("[" * 100_000, '{"w": ' + "1" * 5000 + "}"):
        (source / "transforms.json").write_text(nonsense)
        with pytest.raises(InputError, match=r"transforms\.json: not readable as nerfstudio's cameras"):
            open_source(source, Selection(), None)


SHEARED = [[1, 0.5, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]  # its determinant is 1


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: d.update(frames=[]), '"frames" is missing or empty'),
        (lambda d: d.update(camera_model="OPENCV_FISHEYE"), "OPENCV_FISHEYE"),
        (lambda d: d["frames"][0]["transform_matrix"][0].__setitem__(0, 9.0), "not a rotation and a translation"),
        (lambda d: d["frames"][0].pop("file_path"), "key 'file_path' is missing, for frame 0; export it again"),
        (lambda d: d.pop("w"), "key 'w' is missing, for frame 0; export it again"),
        (lambda d: d.pop("fl_x"), "key 'fl_x' is missing"),
        (lambda d: d.update(h="tall"), "frame 0 cannot be understood"),
        (lambda d: d.update(w=math.inf), "frame 0 cannot be understood"),
        (lambda d: d.update(w=10**400), "frame 0 cannot be understood"),
        (lambda d: d.update(w=320.5), "w and h are 320.5 and 240, expected whole pixels"),
        (lambda d: d.update(w=True), "w is True, expected a number"),
        (lambda d: d.update(fl_x=10**400), "frame 0 cannot be understood"),
        (lambda d: d["frames"][0]["transform_matrix"][0].__setitem__(3, 10**400), "frame 0 cannot be understood"),
        (lambda d: d["frames"][0].update(file_path=7), "file_path is no text"),
        (lambda d: d["frames"][0].update(file_path="\ud800.png"), "file_path is no text"),
        (lambda d: d.update(k4=0.1), "k4 is not supported; undistort the pictures first"),
        (lambda d: d.update(is_fisheye=True), "camera_model a fisheye is not supported"),
        (lambda d: d["frames"][3].update(time=math.nan), "time is nan"),
        (lambda d: d["frames"][3].update(time="noon"), "frame 3 cannot be understood"),
        (lambda d: d["frames"][3].pop("time"), 'only 8 of 9 frames have a "time"'),
        (lambda d: d["frames"][3].update(time=0.5), '"time" of frames/000003.png and frames/000004.png is the same'),
        (lambda d: d["frames"][0].update(file_path="../../secret.png"), "lies outside"),
        (
            lambda d: d["frames"][0]["transform_matrix"].__setitem__(3, [0, 0, 0, 2]),
            "of frames/000000.png is not a rot",
        ),
        (lambda d: d["frames"][0].update(transform_matrix=SHEARED), "of frames/000000.png is not a rotation"),
        (lambda d: d["frames"][1].update(file_path="./frames/000000.png"), "picture frames/000000.png twice"),
        (lambda d: d.update(fl_x=-5.0), "frame 0: the focal length (fl_x, fl_y) is -5"),
        (lambda d: d.update(fl_x=float("nan")), "the focal length (fl_x, fl_y) is nan"),
        (lambda d: d.update(fl_y=1e20), "expected 3.2 to 320000 pixels for pictures of 320x240"),
        (lambda d: d.update(cx=1e9), "the principal point (cx, cy) is 1e+09, 120, far outside"),
        (lambda d: d.update(w=0), "width and height (w, h) are 0x240"),
        (lambda d: d.update(camera_model="OPENCV", k1=-1e6), "no lens distorts like that"),
        (lambda d: d.update(camera_model="OPENCV", k1=float("nan")), "no lens distorts like that"),
        (lambda d: [f.update(file_path="x/" + f["file_path"]) for f in d["frames"]], "holds none of the 9 pictures"),
    ],
)
def test_damaged_transforms_are_refused(tmp_path: Path, change: Callable[[Any], object], says: str) -> None:
    source = given(tmp_path / "given", with_points=False)
    document = json.loads((source / "transforms.json").read_text())
    (source / "capture.json").unlink()  # whose times would hold
    change(document)
    (source / "transforms.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match=r"transforms\.json|given") as refusal:
        open_source(source, Selection(), None)
    assert says in str(refusal.value)


def test_times_of_transforms_are_those_of_its_frames(tmp_path: Path) -> None:
    """Reversed, and with a gap: only order and spacing have a meaning."""
    seconds = [0, 1, 2, 3, 4, 12, 13, 14, 16]
    opened = foreign(
        tmp_path / "given", lambda d: [f.update(time=-3.5 * s) for f, s in zip(d["frames"], seconds, strict=True)]
    )
    pictures = list(opened.pictures)
    assert [p.label for p in pictures] == [f"frames/{i:06}.png" for i in reversed(range(9))]
    assert [p.number for p in pictures] == list(reversed(range(9)))
    mean_step = 16 / 8
    expected = [(16 - s) / mean_step / 30 for s in reversed(seconds)]
    assert [p.time_s for p in pictures] == pytest.approx(expected)
    assert opened.times_s() == pytest.approx(expected)
    assert any("30 frames a second are taken for the mean (--fps)" in note for note in opened.notes)


def test_times_that_are_all_the_same_say_nothing(tmp_path: Path) -> None:
    opened = foreign(tmp_path / "given", lambda d: [f.update(time=0) for f in d["frames"]])
    assert opened.times_s() == pytest.approx(np.arange(9) / 30)
    assert any('"time" is the same for all frames' in note for note in opened.notes)


def test_distortion_is_kept_to_its_last_coefficient(tmp_path: Path) -> None:
    """Whatever the camera's kind is called. OpenCV's formula at one ray, by hand."""
    lens = {"k1": -0.2, "k2": 0.05, "p1": 0.01, "p2": -0.02, "k3": 0.3}
    opened = foreign(tmp_path / "given", lambda d: d.update(camera_model="PINHOLE", **lens))
    assert opened.posed is not None
    camera = next(iter(opened.posed.model.cameras.values()))
    x, y = 0.3, -0.2
    r2 = x * x + y * y
    radial = 1 - 0.2 * r2 + 0.05 * r2**2 + 0.3 * r2**3
    u = x * radial + 2 * 0.01 * x * y - 0.02 * (r2 + 2 * x * x)
    v = y * radial + 0.01 * (r2 + 2 * y * y) - 2 * 0.02 * x * y
    fx, fy, cx, cy = camera.params[:4]
    assert camera.img_from_cam(np.array([x, y, 1.0])) == pytest.approx([fx * u + cx, fy * v + cy])


def test_keys_that_are_not_read_are_named(tmp_path: Path) -> None:
    opened = foreign(tmp_path / "given", lambda d: d["frames"][2].update(mask_path="m.png", colmap_im_id=4))
    unread = "mask_path, ply_file_path, test_filenames, train_filenames, val_filenames"
    assert f"not used of transforms.json: {unread}" in opened.notes


def test_d_nerf_names_its_pictures_without_ending_and_their_size_not_at_all(tmp_path: Path) -> None:
    def change(document: Any) -> None:
        for key in ("w", "h", "cx", "cy", "fl_x", "fl_y", "camera_model", "k1", "k2", "p1", "p2"):
            document.pop(key)
        document["camera_angle_x"] = 2 * math.atan(0.5)
        for frame in document["frames"]:
            frame["file_path"] = "./" + frame["file_path"].removesuffix(".png")

    opened = foreign(tmp_path / "given", change, "transforms_train.json")
    assert [p.label for p in opened.pictures] == [f"frames/{i:06}.png" for i in range(9)]
    assert opened.posed is not None
    camera = next(iter(opened.posed.model.cameras.values()))
    assert (camera.width, camera.height) == (320, 240)
    assert list(camera.params) == pytest.approx([320, 320, 160, 120])


def test_a_camera_that_lies_too_far_away_is_named(tmp_path: Path) -> None:
    source = given(tmp_path / "given", with_points=False)
    document = json.loads((source / "transforms.json").read_text())
    for frame in document["frames"]:
        frame["transform_matrix"][0][3] += 2e4  # a map's coordinates
    (source / "transforms.json").write_text(json.dumps(document))
    says = r"given: the camera of frames/00000\d.png would lie 2e\+04 from the origin .*, over 10000; "
    with pytest.raises(InputError, match=says):
        make_capture(source, tmp_path / "capture", replace(SETTINGS, movers="off"), None, silent)
