"""Views of a second drone: which pixels count, and that they reach scores alone."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aa4d.capture.reader import read_capture
from aa4d.errors import InputError
from aa4d.evaluation.evaluate import evaluate
from aa4d.evaluation.second_drone import FOLDER, scored_frames, second_capture, seen_pixels, training_depths
from tests.toy_capture import ALTITUDE_M, FOCAL, HEIGHT, WIDTH, square_centre, write_toy_capture
from tests.toy_run import silent

ASIDE_M = 6.0


@pytest.fixture
def pair(toy_run: Path, tmp_path: Path) -> tuple[Path, Path]:
    """The capture with a second drone six meters to the north, and the run that was trained on it."""
    shutil.copytree(toy_run.parent, tmp_path / "toy")
    index = write_toy_capture(tmp_path / "toy/capture" / FOLDER, aside_m=ASIDE_M) / "capture.json"
    document = json.loads(index.read_text())
    for frame in document["frames"]:
        frame["split"] = "test"
    index.write_text(json.dumps(document))
    return tmp_path / "toy/capture", tmp_path / "toy/run"


def test_seen_is_what_some_training_frame_shows_and_what_moves(pair: tuple[Path, Path]) -> None:
    """Nadir cameras over a plane: a training frame shows a rectangle of ground around its own place."""
    capture = read_capture(pair[0])
    second = second_capture(capture)
    assert second is not None
    index = 4
    t = second.frames[index].t
    columns, rows = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    x = -2 + 4 * t + (columns - WIDTH / 2) / FOCAL * ALTITUDE_M
    y = ASIDE_M - (rows - HEIGHT / 2) / FOCAL * ALTITUDE_M
    ends = [-2 + 4 * capture.frames[i].t for i in (1, len(capture.frames) - 1)]
    half = np.array([WIDTH, HEIGHT]) / 2 / FOCAL * ALTITUDE_M
    shown = (x > ends[0] - half[0]) & (x < ends[1] + half[0]) & (np.abs(y) < half[1])
    moving = np.abs(np.stack([x, y], -1) - square_centre(t)).max(-1) < 1.5
    seen = seen_pixels(second, index, training_depths(capture))
    assert seen is not None
    assert np.array_equal(seen, shown | moving)
    assert 0.1 < seen.mean() < 0.9


def test_ground_that_something_always_stands_on_is_not_seen(pair: tuple[Path, Path]) -> None:
    """With depth that says otherwise the training frames show another surface."""
    capture = read_capture(pair[0])
    second = second_capture(capture)
    assert second is not None
    nearer = [replace(view, depth=view.depth * 0.9) for view in training_depths(capture)]
    seen = seen_pixels(second, 4, nearer)
    assert seen is not None
    assert seen.sum() == np.load(second.folder / "truth/000004.npz")["instance_id"].astype(bool).sum()


def test_scores_stand_beside_those_of_held_out_frames(pair: tuple[Path, Path]) -> None:
    capture, run = pair
    scores = evaluate(run, capture, silent)
    views = scores.second_drone
    assert views is not None
    assert views.frames == 10
    assert views.seen_share is not None
    assert views.psnr_seen is not None
    assert views.psnr_seen > views.psnr, "what nothing shows is worst"
    assert views.psnr_dynamic is not None
    assert views.psnr_training_times is not None
    assert views.psnr == pytest.approx((8 * views.psnr_training_times + 2 * (views.psnr_held_out_times or 0)) / 10)
    assert len(list((run / "eval" / FOLDER).glob("*.png"))) == 3
    shutil.rmtree(capture / FOLDER)
    alone = evaluate(run, capture, silent)
    assert alone.second_drone is None
    assert alone.psnr == scores.psnr
    assert alone.identity != scores.identity


def test_a_second_drone_of_other_times_is_refused(pair: tuple[Path, Path]) -> None:
    index = pair[0] / FOLDER / "capture.json"
    document = json.loads(index.read_text())
    for frame in document["frames"]:
        frame["time_s"] += 0.05
    index.write_text(json.dumps(document))
    with pytest.raises(InputError, match="frames have other times"):
        evaluate(pair[1], pair[0], silent)


def test_an_unfinished_second_drone_is_refused(pair: tuple[Path, Path]) -> None:
    (pair[0] / FOLDER / "capture.json").unlink()
    with pytest.raises(
        InputError,
        match=r"has no capture\.json, so no capture, or an unfinished one: run the command that makes it again",
    ):
        evaluate(pair[1], pair[0], silent)


def test_scored_frames_are_spread_over_the_clip(pair: tuple[Path, Path]) -> None:
    second = read_capture(pair[0] / FOLDER, to_train=False)
    assert scored_frames(second, 4) == [0, 3, 6, 9]
    assert scored_frames(second, 40) == list(range(10))
