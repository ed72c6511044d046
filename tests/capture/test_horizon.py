"""The horizon is found where there is one, nowhere else, and tells cameras that are turned against each other."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from aa4d.capture.advice import horizon_advice
from aa4d.capture.horizon import Horizon, compare, horizon_line, horizon_of, up_in_camera
from aa4d.capture.pictures import read_gray
from tests.capture import aerial

WIDTH, HEIGHT = 480, 270
K = np.array([[400.0, 0, 238.0], [0, 400.0, 137.0], [0, 0, 1]])
REAL = Path(__file__).resolve().parents[3] / "shared" / "data"
Gray = NDArray[np.uint8]


def camera(pitch_deg: float, roll_deg: float = 0.0, yaw_deg: float = 0.0) -> NDArray[np.float64]:
    """World to camera [4, 4], in a world with z up; at yaw 0 it looks along y."""
    pitch, roll, yaw = np.radians([pitch_deg, roll_deg, yaw_deg])
    level = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    about_z = np.array([[np.cos(yaw), np.sin(yaw), 0], [-np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    up_down = np.array([[1, 0, 0], [0, np.cos(pitch), np.sin(pitch)], [0, -np.sin(pitch), np.cos(pitch)]])
    about_view = np.array([[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]])
    viewmat = np.eye(4)
    viewmat[:3, :3] = about_view @ up_down @ level @ about_z
    return viewmat


def landscape(viewmat: NDArray[np.float64], seed: int = 0) -> Gray:
    """Sky that brightens towards a horizon at infinity, noise, and fields below it."""
    columns, rows = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    rays = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ np.linalg.inv(K).T
    heights = (rays / np.linalg.norm(rays, axis=-1, keepdims=True)) @ viewmat[:3, :3] @ [0, 0, 1]
    random = np.random.default_rng(seed)
    fields = cv2.resize(random.integers(40, 130, (27, 48)).astype(np.float32), (WIDTH, HEIGHT))
    picture = np.where(heights > 0, 190 - 60 * heights, fields) + random.normal(0, 2, rows.shape)
    return np.asarray(np.clip(cv2.GaussianBlur(picture, (0, 0), 0.8), 0, 255), np.uint8)


@pytest.mark.parametrize(("pitch", "roll"), [(-5, 0), (-12, 7), (-12, -20), (3, 2)])
def test_up_is_what_the_camera_s_pitch_and_roll_make_it(pitch: float, roll: float) -> None:
    viewmat = camera(pitch, roll)
    line = horizon_line(landscape(viewmat))
    assert line is not None
    off = np.degrees(np.arccos(min(1.0, float(up_in_camera(line, K) @ viewmat[:3, 2]))))
    assert off < 0.15


def test_the_line_is_in_pixels_of_the_picture_given() -> None:
    picture = landscape(camera(-8, 5))
    small, large = horizon_line(picture), horizon_line(np.asarray(cv2.resize(picture, None, fx=3, fy=3)))
    assert small is not None
    assert large is not None
    assert large[0] / 3 == pytest.approx(small[0], abs=0.3)
    assert large[1] == pytest.approx(small[1], abs=0.003)


def test_towers_before_the_horizon_leave_it_where_it_is() -> None:
    viewmat = camera(-10, 4)
    picture = landscape(viewmat)
    for left in (40, 150, 330):
        picture[20:200, left : left + 60] = np.random.default_rng(left).integers(90, 250, (180, 60))
    line = horizon_line(picture)
    assert line is not None
    assert up_in_camera(line, K) @ viewmat[:3, 2] > np.cos(np.radians(0.2))


def test_a_roof_beside_which_the_sky_goes_on_is_no_horizon() -> None:
    picture = landscape(camera(30))  # sky alone
    picture[120:, 100:340] = 70
    assert horizon_line(picture) is None


def test_pictures_from_above_show_none() -> None:
    pictures = aerial.pictures(aerial.arc(3))
    assert all(horizon_line(np.asarray(cv2.cvtColor(p, cv2.COLOR_RGB2GRAY))) is None for p in pictures)


def test_a_picture_of_few_pixels_or_of_one_brightness_shows_none() -> None:
    assert horizon_line(np.zeros((1, 1), np.uint8)) is None
    assert horizon_line(np.full((180, 320), 128, np.uint8)) is None


@pytest.fixture(scope="module")
def flight() -> tuple[list[Gray], NDArray[np.float64]]:
    """Ten frames of a camera that turns, banks and nods."""
    viewmats = np.array([camera(-9 + 0.4 * i, 3 - 0.8 * i, 5.0 * i) for i in range(10)])
    return [landscape(viewmat, seed) for seed, viewmat in enumerate(viewmats)], viewmats


Flight = tuple[list[Gray], NDArray[np.float64]]


def test_cameras_that_are_right_agree(flight: Flight) -> None:
    pictures, viewmats = flight
    found = horizon_of(pictures, K, viewmats)
    assert found is not None
    assert (found.seen, found.apart) == (10, ())
    assert found.tilt_deg < 0.2
    assert found.spread_deg < 0.4
    assert horizon_advice(found, [str(i) for i in range(10)]) == []


def test_two_cameras_turned_by_20_degrees_are_named(flight: Flight) -> None:
    pictures, viewmats = flight
    turned = viewmats.copy()
    turned[4:6] = camera(20) @ np.linalg.inv(camera(0)) @ viewmats[4:6]
    found = horizon_of(pictures, K, turned)
    assert found is not None
    assert found.apart == (4, 5)
    assert found.spread_deg == pytest.approx(20, abs=0.5)
    said = horizon_advice(found, [f"frame {i}" for i in range(10)])[0].what
    assert said.startswith("frame 4, frame 5: ")
    assert "up to 20 degrees" in said


def test_cameras_that_bend_away_are_wrong_as_a_whole(flight: Flight) -> None:
    pictures, viewmats = flight
    bent = np.array([camera(4.0 * i) @ np.linalg.inv(camera(0)) @ viewmat for i, viewmat in enumerate(viewmats)])
    found = horizon_of(pictures, K, bent)
    assert found is not None
    assert found.spread_deg == pytest.approx(36, abs=0.5)
    assert len(found.apart) > 5
    assert horizon_advice(found, list("0123456789"))[0].what.startswith("The cameras are wrong: ")


def test_a_world_that_is_not_upright_is_told(flight: Flight) -> None:
    pictures, viewmats = flight
    tilted = viewmats @ np.linalg.inv(camera(0)) @ camera(9)
    found = horizon_of(pictures, K, tilted)
    assert found is not None
    assert found.tilt_deg == pytest.approx(9, abs=0.2)
    assert "9 degrees off" in horizon_advice(found, list("0123456789"))[0].what
    steep = replace(found, tilt_deg=87.0)
    said = horizon_advice(steep, list("0123456789"))[0].what
    assert said.startswith("The cameras are wrong: the ground that they make is 87 degrees off what looks like the")
    level = replace(found, tilt_deg=5.0)
    assert horizon_advice(level, list("0123456789")) == [], "ground may slope"


def test_too_few_frames_or_lines_that_jump_about_say_nothing(flight: Flight) -> None:
    _, viewmats = flight
    up = {i: viewmats[i, :3, 2] for i in range(10)}
    assert compare({i: up[i] for i in range(4)}, viewmats) is None
    random = np.random.default_rng(0).normal(size=(10, 3))
    assert compare({i: random[i] / np.linalg.norm(random[i]) for i in range(10)}, viewmats) is None
    assert isinstance(compare(up, viewmats), Horizon)


def test_the_sea_s_horizon_behind_a_town_is_found_in_real_frames() -> None:
    frames = sorted((REAL / "uavdt_S1001" / "frames").glob("*.jpg"))
    if not frames:
        pytest.skip("the real frames of S1001 are not here")
    lines = [horizon_line(read_gray(file)) for file in frames[::8]]
    found = np.array([line for line in lines if line is not None])
    assert len(found) == len(lines)
    at_the_right = found[:, 0] + 1000 * found[:, 1]
    assert (np.abs(at_the_right - 44) < 5).all(), "read off the pictures, 1024 pixels wide"
    assert (np.abs(found[:, 1] - 0.035) < 0.02).all()


def test_photographs_of_a_beach_from_above_have_none() -> None:
    files = sorted((REAL / "brighton_beach").rglob("*.[jJ][pP][gG]"))
    if not files:
        pytest.skip("the photographs of the beach are not here")
    assert [file.name for file in files if horizon_line(read_gray(file)) is not None] == []
