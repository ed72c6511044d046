"""The field of view: found, stated, and doubted where the frames hardly tell it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aa4d.capture.advice import exif_advice, field_of_view_advice, no_model_advice
from aa4d.capture.focal import map_globally
from aa4d.capture.summary import CaptureSummary
from tests.capture import aerial
from tests.capture.making import SETTINGS, make


def test_a_known_field_of_view_is_kept(flight: Path, tmp_path: Path) -> None:
    made = make(flight, tmp_path / "capture", replace(SETTINGS, fov_deg=50.0))
    # That of the undistorted frames is a little less: their edges are cut.
    assert 46 < made.fov_deg <= 50.1
    document = json.loads((made.folder / "work/cameras/done.json").read_text())
    assert document["result"]["attempts"] == 1
    assert made.advice == ()
    assert "Nothing looks wrong" in made.report.read_text()


def test_over_flat_ground_a_found_field_of_view_is_doubted(made: CaptureSummary) -> None:
    """Its roofs are too small and too low to count: every pair of frames passes for pictures of a plane."""
    (line,) = made.advice
    pairs = json.loads((made.folder / "work/matches/done.json").read_text())["result"]["verified"]
    assert line.what.startswith(f"The field of view, {made.fov_deg:.0f} degrees, is doubtful")
    assert "give --fov" in line.what
    assert f"{pairs} of {pairs} pairs look like pictures of one plane" in line.why
    assert f"The {made.fov_deg:.0f} degrees that were found here can be far off" in line.why
    html = made.report.read_text()
    assert "give --fov" in html
    assert "pairs look like pictures of one plane" in html
    assert "taken for moving" not in html  # --movers off


def test_the_field_of_view_is_doubted_where_the_frames_do_not_tell_it() -> None:
    assert field_of_view_advice({"PLANAR": 60, "CALIBRATED": 40}, 60.0, False) == []
    assert field_of_view_advice({"PLANAR": 50, "PANORAMIC": 45, "UNCALIBRATED": 5}, 60.0, False) != []
    # An impossible one was found, and the guess was taken.
    (line,) = field_of_view_advice({"PLANAR": 60, "CALIBRATED": 40}, 64.0, True)
    assert "The 64 degrees that are the usual ones, taken because the frames gave impossible ones, can" in line.why


def test_frames_that_give_another_focal_length_than_exif_s_are_doubted() -> None:
    assert exif_advice(0.8, 1100, 1280, 720) == []
    (line,) = exif_advice(0.8, 2300, 1280, 720)
    assert line.what.startswith("EXIF says a field of view of 64 degrees, and the frames gave 31: ")
    assert "Give --fov 64" in line.what


def test_a_wrong_field_of_view_is_suspected_where_nothing_comes_out() -> None:
    assert "--fov" not in no_model_advice({"CALIBRATED": 9}, False)
    assert no_model_advice({"CALIBRATED": 9}, True).endswith("or --fov is not the camera's: leave it out")
    assert "--fov" not in no_model_advice({}, True)  # frames without a match say nothing of it


def test_the_field_of_view_is_found(made: CaptureSummary) -> None:
    assert made.fov_deg == pytest.approx(2 * np.degrees(np.arctan(160 / aerial.FOCAL)), abs=1.5)


def test_the_global_mapper_finds_the_field_of_view_and_its_failure_is_none(
    made: CaptureSummary, tmp_path: Path
) -> None:
    database, images = made.folder / "work/matches/database.db", made.folder / "work/frames"
    names = sorted(path.name for path in images.glob("*.png"))
    before = database.read_bytes()
    model = map_globally(database, images, names, 0, 1, tmp_path / "found")
    assert model.num_reg_images() == len(names)
    camera = next(iter(model.cameras.values()))
    assert camera.mean_focal_length() == pytest.approx(aerial.FOCAL, rel=0.05)
    assert database.read_bytes() == before
    assert map_globally(database, images, ["nobody.png"], 0, 1, tmp_path / "nothing") is None
    (tmp_path / "empty.db").touch()
    assert map_globally(tmp_path / "empty.db", images, names, 0, 1, tmp_path / "broken") is None
