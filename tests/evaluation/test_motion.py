"""Motion scores against the toy's square, whose way is known in closed form."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from aa4d.capture.reader import Capture, read_capture
from aa4d.capture.truth import depth_of, instance_ids_of
from aa4d.commands.evaluate import metrics_table, motion_rows
from aa4d.errors import InputError
from aa4d.evaluation.evaluate import evaluate
from aa4d.evaluation.flow_agreement import optical_flow
from aa4d.evaluation.group_error import match
from aa4d.evaluation.motion import MotionScores, Travels, measure_motion, motion_steps
from aa4d.evaluation.motion_picture import flow_color
from aa4d.evaluation.true_motion import TrueMotion, instances_of, read_true_tracks, true_motion
from aa4d.methods.model_file import LoadedModel, load_model, save_model
from tests.toy_capture import ALTITUDE_M, FOCAL, HEIGHT, WIDTH
from tests.toy_riders import ride

STEP_M = 12 / 9  # of the square between two frames
CAMERA_M = 4 / 9
PX_PER_M = FOCAL / ALTITUDE_M


@pytest.fixture
def loaded(toy_run: Path) -> LoadedModel:
    """For a test alone, which may change it."""
    return load_model(toy_run / "model.safetensors")


@pytest.fixture
def capture(toy_run: Path) -> Capture:
    return read_capture(toy_run.parent / "capture")


def scores_of(loaded: LoadedModel, capture: Capture) -> MotionScores:
    calls: list[None] = []
    motion = measure_motion(loaded, None, capture, lambda: calls.append(None))
    assert len(calls) == motion_steps(loaded, capture)
    return motion.scores


def everyone(loaded: LoadedModel) -> torch.Tensor:
    return torch.zeros(len(loaded.model.anchors), dtype=torch.long)


def test_true_motion_is_that_of_the_square(capture: Capture) -> None:
    tracks = read_true_tracks(capture)
    ids, depth = instance_ids_of(capture, 4), depth_of(capture, 4)
    assert tracks is not None
    assert ids is not None
    assert depth is not None
    truth = true_motion(tracks, depth, instances_of(tracks, ids), 4, 5)
    assert len(truth.rows) == (ids == 1).sum()
    np.testing.assert_allclose(truth.displacement_m, [[STEP_M, 0, 0]] * len(truth.rows), atol=1e-9)
    np.testing.assert_allclose(truth.camera_flow_px, [[-CAMERA_M * PX_PER_M, 0]] * len(truth.rows), atol=1e-9)
    np.testing.assert_allclose(truth.flow_px, [[(STEP_M - CAMERA_M) * PX_PER_M, 0]] * len(truth.rows), atol=1e-9)


def test_what_is_gone_by_the_next_frame_has_no_motion(capture: Capture) -> None:
    tracks = read_true_tracks(capture)
    ids, depth = instance_ids_of(capture, 4), depth_of(capture, 4)
    assert tracks is not None
    assert ids is not None
    assert depth is not None
    present = tracks.present.copy()
    present[5] = False
    gone = replace(tracks, present=present)
    assert not len(true_motion(gone, depth, instances_of(gone, ids), 4, 5).rows)


def test_riders_on_the_true_way_travel_all_of_it(loaded: LoadedModel, capture: Capture) -> None:
    ride(loaded, everyone(loaded))
    scores = scores_of(loaded, capture)
    assert scores.travel_ratio == pytest.approx(1, abs=1e-3)
    assert scores.travel_instances == scores.moving_instances == scores.groups == scores.groups_matched == 1
    assert scores.group_error_m == pytest.approx(0, abs=1e-4)
    # What is drawn is not quite as deep as the square: its parallax differs a little.
    assert scores.motion_epe_px == pytest.approx(0, abs=0.2)
    assert scores.motion_epe_px_static == pytest.approx(STEP_M * PX_PER_M)


def test_riders_at_half_the_pace_travel_half_the_way(loaded: LoadedModel, capture: Capture) -> None:
    ride(loaded, everyone(loaded), pace=0.5)
    scores = scores_of(loaded, capture)
    assert scores.travel_ratio == pytest.approx(0.5, abs=1e-3)
    assert scores.motion_epe_px == pytest.approx(STEP_M * PX_PER_M / 2, abs=0.2)
    assert scores.motion_epe_px_median == pytest.approx(scores.motion_epe_px, abs=0.2)
    # At t it lies 6 t behind; of the training frames 1 to 7 and 9 that is 3 m in the median (4.5 / 9 of 6 m).
    assert scores.group_error_m == pytest.approx(np.mean([6 * 4.5 / 9, 6 * (8 / 9) - 6 * 4.5 / 9]), abs=0.02)


def test_a_group_that_stands_anywhere_on_its_instance_has_no_error(loaded: LoadedModel, capture: Capture) -> None:
    ride(loaded, everyone(loaded))
    assert loaded.model.groups is not None
    with torch.no_grad():
        loaded.model.groups.position.add_(torch.tensor([0.8, -0.4, 0.2]) / loaded.frame.unit_m)
    assert scores_of(loaded, capture).group_error_m == pytest.approx(0, abs=1e-4)


def test_a_model_without_motion_travels_nowhere(toy_run: Path, capture: Capture) -> None:
    coarse = load_model(toy_run / "coarse.safetensors")
    scores = scores_of(coarse, capture)
    assert scores.travel_ratio == pytest.approx(0, abs=1e-9)
    assert scores.motion_epe_px == pytest.approx(scores.motion_epe_px_static, abs=0.2)
    assert (scores.groups, scores.groups_matched, scores.group_error_m) == (0, 0, None)


def test_many_groups_are_drawn_in_several_passes(loaded: LoadedModel, capture: Capture) -> None:
    always = ((-2.0, -1.0, 2.0, 3.0),)
    ride(loaded, torch.full((len(loaded.model.anchors),), 38), shown=always * 40)
    assert scores_of(loaded, capture).groups_matched == 1


def test_an_instance_has_the_group_that_shows_most_of_it() -> None:
    votes = np.array([[5, 0, 1], [9, 2, 0], [0, 0, 0], [1, 0, 4]])
    assert match(votes) == {0: 1, 2: 3}
    assert match(np.zeros((0, 3), np.int64)) == {}


def test_travel_counts_what_goes_along_the_way() -> None:
    n = 30
    flow = np.tile([6.0, 0], (n, 1))
    zeros = np.zeros(n, np.int64)
    truth = TrueMotion(zeros, zeros, zeros, np.tile([2.0, 0, 0], (n, 1)), flow, np.zeros((n, 2)))
    travels = Travels(2)
    travels.add(truth, np.tile([1.0, 5.0, 0], (n, 1)))  # sideways is not along
    travels.add(truth, np.tile([-2.0, 0, 0], (n, 1)))
    assert travels.ratios().tolist() == [pytest.approx(-0.25)]
    short = Travels(2)
    short.add(replace(truth, flow_px=flow / 2), np.tile([1.0, 0, 0], (n, 1)))
    assert not len(short.ratios())


def footage(capture: Capture) -> Capture:
    """The same frames with masks of movers in place of truth."""
    (capture.folder / "movers").mkdir()
    for index, frame in enumerate(capture.frames):
        ids = instance_ids_of(capture, index)
        assert ids is not None
        Image.fromarray(np.where(ids == 1, 255, 0).astype(np.uint8)).save(capture.folder / f"movers/{frame.name}.png")
    return replace(capture, tracks=None, frames=tuple(replace(frame, truth=None) for frame in capture.frames))


def test_without_truth_motion_is_held_against_optical_flow(loaded: LoadedModel, toy_capture: Path) -> None:
    real = footage(read_capture(toy_capture))
    ride(loaded, everyone(loaded))
    along = scores_of(loaded, real)
    assert (along.motion_epe_px, along.travel_ratio, along.group_error_m, along.moving_instances) == (None,) * 4
    loaded = load_model(loaded.path)
    ride(loaded, everyone(loaded), pace=-2)
    astray = scores_of(loaded, real)
    assert along.flow_agreement_px is not None
    assert astray.flow_agreement_px is not None
    # The toy's square is of one colour and six pixels wide, of which flow sees little but the rim.
    assert along.flow_agreement_px < 1.5 < 0.5 * astray.flow_agreement_px


def test_optical_flow_follows_a_shift_and_believes_it() -> None:
    rng = np.random.default_rng(0)
    coarse = Image.fromarray(rng.integers(0, 255, (12, 16, 3), dtype=np.uint8))
    picture = np.array(coarse.resize((128, 96), Image.Resampling.BICUBIC))
    flow, believed = optical_flow(picture, np.roll(picture, (1, 2), axis=(0, 1)))
    inner = np.s_[20:-20, 20:-20]
    np.testing.assert_allclose(np.median(flow[inner], axis=(0, 1)), [2, 1], atol=0.1)
    assert believed[inner].mean() > 0.9


def test_without_truth_or_masks_nothing_is_measured(loaded: LoadedModel, capture: Capture) -> None:
    bare = replace(capture, tracks=None, frames=tuple(replace(frame, truth=None) for frame in capture.frames))
    assert scores_of(loaded, bare) == MotionScores()


def test_scores_reach_the_file_the_table_and_a_picture(
    loaded: LoadedModel, capture: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "weights").mkdir()
    monkeypatch.setenv("AA4D_WEIGHTS", str(tmp_path / "weights"))
    ride(loaded, everyone(loaded))
    run = tmp_path / "run"
    run.mkdir()
    save_model(
        run / "model.safetensors", loaded.method, loaded.model, is_static=False, capture=capture, frame=loaded.frame,
        background=loaded.background, training={"seconds": 1.0},
    )  # fmt: skip
    steps: list[tuple[int, int]] = []
    metrics = evaluate(run, capture.folder, lambda done, total: steps.append((done, total))).as_json()
    assert steps == [(i + 1, steps[-1][1]) for i in range(steps[-1][1])]
    assert metrics["travel_ratio"] == pytest.approx(1, abs=1e-3)
    assert "motion" not in metrics
    assert [row[0] for row in motion_rows(metrics)] == [
        "motion, end-point error",
        "motion, end-point error, median",
        "drawn travel / true travel (instances: 1)",
        "rigid groups",
        "error of their trajectories, median",
    ]
    assert metrics_table(metrics).row_count > 10
    with Image.open(run / "eval/motion.png") as picture:
        assert picture.size == (2 * WIDTH, HEIGHT)


def test_still_is_white_and_directions_differ() -> None:
    colors = flow_color(np.array([[0.0, 0], [1, 0], [-1, 0]]), 1.0)
    np.testing.assert_allclose(colors, [[1, 1, 1], [1, 0, 0], [0, 1, 1]], atol=1e-9)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda a: a | {"object_to_world": a["object_to_world"][:-1]}, "object_to_world has shape"),
        (lambda a: a | {"present": np.ones((2, 2), bool)}, "present has shape"),
        (lambda a: {k: v for k, v in a.items() if k != "moving"}, "array .moving. cannot be read"),
    ],
)
def test_damaged_tracks_are_refused(toy_capture: Path, change: object, says: str) -> None:
    path = toy_capture / "truth/tracks.npz"
    with np.load(path) as file:
        arrays = dict(file)
    assert callable(change)
    np.savez(path, **change(arrays))
    with pytest.raises(InputError, match=says):
        read_true_tracks(read_capture(toy_capture))


def test_missing_tracks_are_named(toy_capture: Path) -> None:
    capture = read_capture(toy_capture)
    shutil.move(toy_capture / "truth/tracks.npz", toy_capture / "elsewhere.npz")
    with pytest.raises(InputError, match="truth is missing"):
        read_true_tracks(capture)
