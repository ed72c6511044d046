"""Photographs in order, and cameras that are checked wherever they come from."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pycolmap
import pytest

from aa4d.capture.intrinsics import check_intrinsics
from aa4d.capture.make import make_capture
from aa4d.capture.settings import Selection
from aa4d.capture.sources import open_source
from aa4d.capture.sources.posed import same_shape
from aa4d.errors import InputError
from tests.capture.given import SETTINGS, edited, given, photograph, silent


def test_a_counter_that_begins_anew_is_put_in_order_by_exif(tmp_path: Path) -> None:
    """DJI counts to 0999 and goes on with 0001; two photographs may be of one second."""
    names = ["0997", "0998", "0999", "0001", "0002"]
    for name, second in zip(names, ("10", "12", "14", "14", "16"), strict=True):
        photograph(tmp_path / f"DJI_{name}.jpg", f"2024:06:01 12:00:{second}")
    opened = open_source(tmp_path, Selection(), None)
    assert [p.label for p in opened.pictures] == [f"DJI_{name}.jpg" for name in names]
    assert opened.times_s() == pytest.approx([0, 2, 4, 4.5, 6])
    assert any("begins anew" in note for note in opened.notes)
    stated = open_source(tmp_path, Selection(source_fps=2), None)
    assert [p.label for p in stated.pictures] == [f"DJI_{name}.jpg" for name in names]
    assert stated.times_s() == pytest.approx([0, 0.5, 1, 1.5, 2])


def test_names_without_exif_keep_their_order_and_their_gaps(tmp_path: Path) -> None:
    for number in (3, 4, 7):
        photograph(tmp_path / f"{number}.jpg", "2024:06:01 12:00:00" if number == 3 else None)
    opened = open_source(tmp_path, Selection(source_fps=10), None)
    assert opened.times_s() == pytest.approx([0, 0.1, 0.4])
    assert opened.notes == []


def test_strong_lenses_are_not_refused() -> None:

    for model, params in (
        ("OPENCV", [500.0, 505, 330, 228, -0.3, 0.12, 0.001, -0.002]),
        ("OPENCV_FISHEYE", [300.0, 300, 320, 240, 0.05, -0.01, 0.0, 0.0]),
        ("SIMPLE_RADIAL", [2500.0, 320, 240, 0.4]),
    ):
        check_intrinsics(pycolmap.Camera(model=model, width=640, height=480, params=params), "x")


@pytest.mark.parametrize("is_colmap", [True, False])
def test_a_camera_of_another_shape_than_the_pictures_is_refused(tmp_path: Path, is_colmap: bool) -> None:
    source = given(tmp_path / "given", with_points=True)
    if is_colmap:
        (source / "transforms.json").unlink()
        edited(source, "cameras.txt", "320 240", "240 320")
    else:
        document = json.loads((source / "transforms.json").read_text())
        (source / "transforms.json").write_text(json.dumps(document | {"w": 240, "h": 320}))
    with pytest.raises(InputError, match=r"camera is 240x320, which is not the shape of the pictures, 320x240"):
        make_capture(source, tmp_path / "capture", replace(SETTINGS, movers="off"), None, silent)
    assert not (tmp_path / "capture").exists()


def test_sizes_of_one_picture() -> None:
    assert same_shape((240, 126), (1024, 540))
    assert same_shape((1024, 540), (240, 127))
    assert same_shape((3840, 2160), (960, 540))
    assert not same_shape((1024, 540), (1024, 576))
    assert not same_shape((640, 480), (480, 640))
