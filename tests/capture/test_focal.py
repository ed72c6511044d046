"""The start of the focal length is the one that explains the frames best, and what was tried is told."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest

from aa4d.capture import focal
from aa4d.capture.advice import field_of_view_advice, stated_field_of_view_advice
from aa4d.capture.focal import Start, Tried, best_of, find_start, held_and_freed, probed_frames, rivals
from aa4d.capture.selfcheck import standing_out
from aa4d.capture.settings import PRESETS

WIDTH, HEIGHT = 1280, 720
NAMES = [f"{i:06}.png" for i in range(60)]
# Mean errors of a clip whose true field of view is 60 degrees, where the usual start falls into the wrong minimum.
FOUND = {30: (29.0, 1.22), 45: (60.0, 0.50), 64: (29.0, 1.22), 75: (60.0, 0.51), 95: (88.0, 1.4)}


@dataclass
class Model:
    """As much of a COLMAP model as the choice looks at."""

    fov_deg: float
    error_px: float
    frames: int = 20

    @property
    def cameras(self) -> dict[int, Any]:
        focal_px = 0.5 * WIDTH / math.tan(math.radians(self.fov_deg) / 2)
        return {1: pycolmap.Camera(model="SIMPLE_RADIAL", width=WIDTH, height=HEIGHT, params=[focal_px, 640, 360, 0])}

    def compute_mean_reprojection_error(self) -> float:
        return self.error_px

    def num_reg_images(self) -> int:
        return self.frames


def database(path: Path, stated: bool = False) -> Path:
    with pycolmap.Database.open(path) as opened:
        camera = pycolmap.Camera(model="SIMPLE_RADIAL", width=WIDTH, height=HEIGHT, params=[0.8 * WIDTH, 640, 360, 0])
        camera.has_prior_focal_length = stated
        opened.write_camera(camera)
    return path


def fov_in(path: Path) -> float:
    with pycolmap.Database.open(path) as opened:
        return math.degrees(2 * math.atan(0.5 * WIDTH / opened.read_all_cameras()[0].params[0]))


def start_of(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    found: dict[int, Any],
    globally: Any,
    stated: bool = False,
    names: list[str] = NAMES,
) -> Start:
    monkeypatch.setattr(focal, "map_globally", lambda *_: globally)

    def map_part(path: Path, part: list[str], _: Path) -> Any:
        assert part == probed_frames(names, 3)
        return None if (made := found.get(round(fov_in(path)))) is None else Model(*made)

    given, settings = database(folder / "database.db", stated), replace(PRESETS["fast"], window=3)
    return find_start(given, folder, names, settings, 0, 1, folder, map_part, lambda model: model.fov_deg < 120)


def test_a_local_minimum_is_left_for_a_better_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    start = start_of(tmp_path, monkeypatch, FOUND, Model(61.0, 0.6))
    assert start.tried[start.chosen].start == "45 degrees"
    assert fov_in(start.database) == pytest.approx(60)
    assert fov_in(tmp_path / "database.db") == pytest.approx(64, abs=0.1)  # what was given stays
    (note,) = start.notes()
    assert "64 degrees: 29 degrees, 20 frames, 1.22 px; global mapper: 61 degrees" in note
    assert "used is what 45 degrees found" in note


def test_without_a_global_mapper_all_starts_are_tried(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    start = start_of(tmp_path, monkeypatch, FOUND, None)
    assert [t.start for t in start.tried] == [f"{d} degrees" for d in (64, 30, 45, 75, 95)]
    assert start.tried[start.chosen].fov_deg == pytest.approx(60)


@pytest.mark.parametrize("frames", [3, 9])
def test_a_clip_of_few_frames_is_tried_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, frames: int) -> None:
    start = start_of(tmp_path, monkeypatch, FOUND, None, names=NAMES[:frames])
    assert start.probed == frames
    assert start.tried[start.chosen].fov_deg == pytest.approx(60)


def test_two_frames_are_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert start_of(tmp_path, monkeypatch, FOUND, None, names=NAMES[:2]) == Start(tmp_path / "database.db")


def test_where_the_usual_start_is_as_good_nothing_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    start = start_of(tmp_path, monkeypatch, {64: (57.0, 0.52)}, Model(58.0, 0.50))
    assert (start.database, start.chosen, len(start.tried)) == (tmp_path / "database.db", 0, 2)
    assert start.notes() == []


def test_degrees_are_horizontal_in_an_upright_clip_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As --fov is: what is 60 degrees across 1280 pixels of height is 36 across 720 of width."""
    monkeypatch.setattr(f"{__name__}.WIDTH", 720)
    monkeypatch.setattr(f"{__name__}.HEIGHT", 1280)
    start = start_of(tmp_path, monkeypatch, {64: (36.0, 0.5)}, None)
    assert [str(tried) for tried in start.tried] == ["64 degrees: 36 degrees, 20 frames, 0.50 px"]


@pytest.mark.parametrize("stated", [True, False])
def test_a_stated_focal_length_and_impossible_ones_are_no_question(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stated: bool
) -> None:
    impossible = dict.fromkeys(FOUND, (128.0, 0.9))
    start = start_of(tmp_path, monkeypatch, impossible, None, stated)
    assert start == Start(tmp_path / "database.db")


def test_few_frames_with_a_low_error_are_not_the_best() -> None:
    tried = [Tried("64 degrees", 60, 20, 0.6), Tried("30 degrees", 31, 9, 0.2), Tried("95 degrees", 90, 19, 0.7)]
    assert best_of(tried) == 0


def test_a_field_of_view_that_explains_as_much_is_told() -> None:
    tried = (Tried("64 degrees", 60, 20, 0.50), Tried("30 degrees", 31, 20, 0.53), Tried("95 degrees", 90, 20, 0.9))
    assert rivals(tried, 0) == [tried[1]]
    (said,) = field_of_view_advice({"CALIBRATED": 9}, 60, was_kept=False, rivals=rivals(tried, 0))
    assert "60 degrees, is doubtful" in said.what
    assert "31 degrees (0.53 px)" in said.why
    assert field_of_view_advice({"CALIBRATED": 9}, 60, was_kept=False) == []


def test_the_part_that_is_tried_is_in_the_middle_and_matched() -> None:
    part = probed_frames([str(i) for i in range(150)], 3)
    assert part == [str(i) for i in range(39, 111, 3)]
    assert probed_frames(NAMES[:24], 3) == NAMES[:24:2]
    assert probed_frames(NAMES[:9], 3) == NAMES[:9]


def test_frames_that_stand_out_are_found() -> None:
    """Of a slow turn, frame 7 looks 20 degrees aside, and frame 3 has a large error."""
    angles = np.radians(2.0 * np.arange(12))
    angles[7] += np.radians(20)
    viewmats = np.tile(np.eye(4), (12, 1, 1))
    viewmats[:, 0, 0] = viewmats[:, 1, 1] = np.cos(angles)
    viewmats[:, 0, 1], viewmats[:, 1, 0] = -np.sin(angles), np.sin(angles)
    names = [f"{i}" for i in range(12)]
    errors = dict.fromkeys(names, 0.4) | {"3": 2.1}
    assert standing_out(names, viewmats, errors, 1.0) == ["3", "7", "8"]
    assert standing_out(names[:7], viewmats[:7], dict.fromkeys(names[:7], 0.4), 1.0) == []


def flight(stated_deg: float, heights_m: float) -> pycolmap.Reconstruction:
    """A clip of 60 degrees, 0.3 px of noise, mapped with a stated field of view that adjustment had to hold.

    The drone flies an arc and looks down at 35 degrees on ground with boxes up to `heights_m`.
    """
    random = np.random.default_rng(0)
    points = np.column_stack([random.uniform(-60, 60, (400, 2)), random.uniform(0, heights_m, 400)])
    true_px, stated_px = (0.5 * WIDTH / math.tan(math.radians(degrees) / 2) for degrees in (60.0, stated_deg))
    model = pycolmap.Reconstruction()
    camera = pycolmap.Camera(model="SIMPLE_RADIAL", width=WIDTH, height=HEIGHT, params=[stated_px, 640, 360, 0])
    camera.camera_id = 1
    model.add_camera_with_trivial_rig(camera)
    tracks: dict[int, pycolmap.Track] = {i: pycolmap.Track() for i in range(len(points))}
    for frame in range(12):
        angle = math.radians(4 * frame)
        center = np.array([90 * math.sin(angle), -90 * math.cos(angle), 60.0])
        forward = -center / np.linalg.norm(center)
        right = np.cross(forward, [0, 0, 1])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        seen = (points - center) @ rotation.T
        pixels = true_px * seen[:, :2] / seen[:, 2:] + [640, 360] + random.normal(0, 0.3, (len(points), 2))
        image = pycolmap.Image(name=NAMES[frame], keypoints=pixels, camera_id=1, image_id=frame + 1)
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(rotation), -rotation @ center)
        model.add_image_with_trivial_frame(image, pose)
        for i, track in tracks.items():
            track.add_element(frame + 1, i)
    for i, track in tracks.items():
        model.add_point3D(points[i], track, np.zeros(3, np.uint8))
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_focal_length = False
    options.print_summary = False
    pycolmap.bundle_adjustment(model, options)
    model.update_point_3d_errors()
    return model


@pytest.mark.parametrize("stated_deg", [40.0, 75.0])
def test_a_stated_field_of_view_that_the_frames_contradict_is_questioned(stated_deg: float) -> None:
    held, freed = held_and_freed(flight(stated_deg, 30.0), threads=1)
    assert held.fov_deg == pytest.approx(stated_deg)
    assert freed.fov_deg == pytest.approx(60, abs=2)
    assert freed.error_px == pytest.approx(0.36, abs=0.05)  # the mean length of noise in two directions
    (said,) = stated_field_of_view_advice(held, freed)
    assert said.what.startswith(f"--fov {stated_deg:.0f} contradicts the frames: it explains them to ")
    assert f", and {freed.fov_deg:.0f} degrees would to 0." in said.what


@pytest.mark.parametrize(("stated_deg", "heights_m"), [(60.0, 30.0), (62.0, 30.0), (60.0, 0.0)])
def test_a_right_one_is_not_and_one_that_flat_ground_hardly_tells_neither(stated_deg: float, heights_m: float) -> None:
    assert stated_field_of_view_advice(*held_and_freed(flight(stated_deg, heights_m), threads=1)) == []
