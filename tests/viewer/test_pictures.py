"""Pictures of the toy run, without a browser: what a window shows is what the rasteriser draws."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from aa4d.capture.reader import read_capture, read_image
from aa4d.evaluation.views import render_frame
from aa4d.viewer.arrangement import DIFFERENCE, SIDE_BY_SIDE
from aa4d.viewer.cameras import Eye, fov_that_shows
from aa4d.viewer.following import Followed
from aa4d.viewer.pictures import LAYER_NAMES, Painter, Picture, Wanted, legend, point_under
from aa4d.viewer.shown import Shown
from tests.toy_capture import ALTITUDE_M, HEIGHT, WIDTH
from tests.toy_riders import ride

INDEX = 3


@pytest.fixture(scope="module")
def shown(toy_run: Path) -> Shown:
    return Followed(toy_run, None).load()


@pytest.fixture(scope="module")
def other(toy_run: Path) -> Shown:
    """The same with all anchors half a metre higher."""
    other = Followed(toy_run, None).load()
    with torch.no_grad():
        other.loaded.model.anchors.position[:, 2] += 0.5 / other.loaded.frame.unit_m
    return other


def at_frame(shown: Shown, **options: object) -> Wanted:
    frame, aspect = shown.loaded.frames[INDEX], WIDTH / HEIGHT
    eye = Eye(frame.viewmat, fov_that_shows(shown.loaded.camera, aspect))
    return replace(Wanted(eye, aspect, frame.time_s), **options)


def picture(shown: tuple[Shown, ...], wanted: Wanted, width: int = WIDTH, height: int = HEIGHT) -> Picture:
    return Painter().picture(shown, wanted, width, height)


def test_from_a_frame_s_camera_it_is_the_frame_s_own_render(shown: Shown) -> None:
    capture = read_capture(shown.loaded.capture_folder)
    drawn = picture((shown,), at_frame(shown)).pixels
    assert np.abs(drawn.astype(int) - render_frame(shown.loaded, capture, INDEX)).max() <= 1


@pytest.mark.parametrize("layer", LAYER_NAMES)
def test_every_layer_is_drawn_at_every_size_or_says_why_not(shown: Shown, layer: str) -> None:
    for width, height in ((WIDTH, HEIGHT), (12, 8), (97, 31)):
        drawn = picture((shown,), at_frame(shown, layer=layer, ribbons=True), width, height)
        assert drawn.pixels.shape == (height, width, 3)
        assert drawn.pixels.dtype == np.uint8
        assert (layer in shown.lacking) == bool(drawn.notes)
        if drawn.scale is not None:
            assert legend(drawn.scale).shape[2] == 3


def test_the_frame_layer_is_the_capture_s_picture_and_error_the_distance_to_it(shown: Shown) -> None:
    capture = read_capture(shown.loaded.capture_folder)
    truth = read_image(capture, capture.frames[INDEX])
    assert np.abs(picture((shown,), at_frame(shown, layer="frame")).pixels.astype(int) - truth).max() <= 1
    drawn = picture((shown,), at_frame(shown, layer="error"))
    error = np.abs(render_frame(shown.loaded, capture, INDEX).astype(float) - truth).mean(axis=2) / 255
    assert drawn.scale is not None
    expected = drawn.scale.colored(error.astype(np.float32))
    assert np.abs(drawn.pixels.astype(int) - expected).max() <= 8


def test_away_from_the_frames_there_is_no_error_to_show(shown: Shown) -> None:
    wanted = at_frame(shown, layer="error")
    moved = wanted.eye.viewmat.copy()
    moved[2, 3] += 1
    drawn = picture((shown,), replace(wanted, eye=Eye(moved, wanted.eye.fov)))
    assert "only from where a frame was taken" in drawn.notes[0]


def test_a_model_less_itself_is_nothing_and_less_a_higher_one_its_height(shown: Shown, other: Shown) -> None:
    both = {"models": (0, 1), "arrangement": DIFFERENCE}
    same = picture((shown, shown), at_frame(shown, **both))
    assert same.scale is not None
    assert np.array_equal(np.unique(same.pixels.reshape(-1, 3), axis=0), legend(same.scale)[:1, 0])
    assert picture((shown, shown), at_frame(shown, ribbons=True, **both)).notes == ("tracks: not over a difference",)
    deeper = picture((shown, other), at_frame(shown, layer="depth", **both))
    assert deeper.scale is not None
    lower, upper = deeper.scale.bounds
    assert lower == -upper
    assert 0.4 < upper < 0.8


def test_side_by_side_each_cell_is_that_model_alone(shown: Shown, other: Shown) -> None:
    wanted = at_frame(shown, models=(0, 1), arrangement=SIDE_BY_SIDE, aspect=2 * WIDTH / HEIGHT)
    drawn = picture((shown, other), wanted, 2 * WIDTH, HEIGHT).pixels
    below_labels = slice(HEIGHT // 2, -4)
    for number, its in enumerate((shown, other)):
        alone = picture((its,), replace(wanted, models=(0,), arrangement="one"))
        assert alone.pixels.shape == (HEIGHT, WIDTH, 3)
        part = drawn[below_labels, number * WIDTH : (number + 1) * WIDTH - 4]
        np.testing.assert_array_equal(part, alone.pixels[below_labels, : WIDTH - 4])


def test_a_scale_stays_as_the_camera_moves(shown: Shown) -> None:
    painter, wanted = Painter(), at_frame(shown, layer="depth")
    moved = wanted.eye.viewmat.copy()
    moved[2, 3] += 5
    scales = [
        painter.picture((shown,), replace(wanted, eye=Eye(viewmat, 1.0)), 30, 20).scale
        for viewmat in (wanted.eye.viewmat, moved)
    ]
    assert scales[0] is scales[1]


def test_what_is_under_a_place_of_the_window_is_on_the_ground(shown: Shown) -> None:
    point = point_under((shown,), at_frame(shown), 0.75, 0.25)
    assert point is not None
    center = at_frame(shown).eye.center()
    expected = [center[0] + WIDTH / 4 / 40 * ALTITUDE_M, center[1] + HEIGHT / 4 / 40 * ALTITUDE_M, 0]
    assert np.abs(point - expected).max() < 1.5  # a model of 40 iterations
    beside = at_frame(shown, models=(0, 1), arrangement=SIDE_BY_SIDE)
    left, right = (point_under((shown, shown), beside, x, 0.5) for x in (0.25, 0.75))
    assert left is not None
    np.testing.assert_allclose(left, right)


def test_rigid_groups_are_drawn_and_have_ribbons(toy_run: Path) -> None:
    shown = Followed(toy_run, None).load()
    x, y = shown.loaded.model.centers(None)[:, :2].T
    ride(shown.loaded, torch.where((x.abs() < 0.1) & (y.abs() < 0.1), 0, -1))
    assert "movers" not in shown.lacking
    with_tracks = picture((shown,), at_frame(shown, ribbons=True), 96, 64).pixels
    assert len(shown.ribbons) == 1
    assert (with_tracks != picture((shown,), at_frame(shown), 96, 64).pixels).any()


def test_a_static_model_is_shown_at_every_second(toy_run: Path, tmp_path: Path) -> None:
    (tmp_path / "model.safetensors").write_bytes((toy_run / "coarse.safetensors").read_bytes())
    shown = Followed(tmp_path, toy_run.parent / "capture").load()
    early, late = (
        picture((shown,), replace(at_frame(shown, ribbons=True, layer=layer), second=second)).pixels
        for layer, second in (("color", 0.0), ("color", 0.9))
    )
    np.testing.assert_array_equal(early, late)
    assert shown.ribbons == ()
    assert "activity" in shown.lacking
