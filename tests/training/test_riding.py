"""Anchors that ride with what moves, from true tracks to the trained model."""

import os
import signal
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from aa4d.capture.reader import Capture, read_capture
from aa4d.errors import InputError, Interrupted
from aa4d.evaluation.evaluate import evaluate
from aa4d.methods.model_file import load_model
from aa4d.methods.settings import Decay, MotionSettings
from aa4d.motion.tracks import Tracks
from aa4d.motion.tracks_file import load_tracks, save_tracks, tracks_path
from aa4d.motion.truth import truth_tracks
from aa4d.training import movers
from aa4d.training.riding import membership_loss
from aa4d.training.trainer import train
from tests.toy_capture import square_centre, write_toy_capture
from tests.training.short_run import RIDING, SHORT


def silent(*_: object) -> None:
    pass


@pytest.fixture(scope="module")
def toy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_toy_capture(tmp_path_factory.mktemp("toy") / "capture", frames=17)


def test_a_mover_that_rides_is_sharp_at_times_that_training_never_saw(toy: Path, tmp_path: Path) -> None:
    dynamic = {}
    for name, config in (("none", SHORT), ("tracks", RIDING)):
        run = tmp_path / name
        train(read_capture(toy), run, replace(config, coarse_iterations=100, fine_iterations=200), silent)
        dynamic[name] = evaluate(run, toy, silent).psnr_dynamic
    assert dynamic["none"] is not None
    assert dynamic["tracks"] is not None
    assert dynamic["tracks"] > dynamic["none"] + 3


def test_true_tracks_are_where_the_truth_is(toy: Path) -> None:
    capture = read_capture(toy)
    frames = capture.of_split("train")
    tracks = truth_tracks(capture, frames)
    assert tracks.names == ("square",)
    t = np.array([frame.t for frame in capture.frames])
    np.testing.assert_allclose(tracks.poses(t)[0, :, :2], [square_centre(s) for s in t], atol=1e-4)
    assert (tracks.presence(t) == 1).all()
    assert tracks.labels.any(axis=(1, 2)).all()
    assert (tracks.moving | (tracks.labels == 0)).all()


def test_true_tracks_are_refused_where_there_is_no_truth(toy: Path) -> None:
    capture = replace(read_capture(toy), tracks=None)
    with pytest.raises(InputError, match="no truth to take tracks from; use --tracks pictures"):
        truth_tracks(capture, capture.of_split("train"))


def test_where_nothing_moves_the_model_is_the_papers_bit_for_bit(tmp_path: Path) -> None:
    folder = write_toy_capture(tmp_path / "capture")
    with np.load(folder / "truth/tracks.npz") as file:
        arrays = dict(file)
    arrays["object_to_world"][:] = arrays["object_to_world"][0]
    np.savez(folder / "truth/tracks.npz", **arrays)
    for name, config in (("none", SHORT), ("tracks", RIDING)):
        train(read_capture(folder), tmp_path / name, config, silent)
    none, tracks = (load_model(tmp_path / name / "model.safetensors").model for name in ("none", "tracks"))
    assert tracks.groups is None
    assert none.state_dict().keys() == tracks.state_dict().keys()
    for key, value in none.state_dict().items():
        assert torch.equal(value, tracks.state_dict()[key]), key


def test_a_riders_model_survives_its_file(toy: Path, tmp_path: Path) -> None:
    train(read_capture(toy), tmp_path / "run", RIDING, silent)
    loaded = load_model(tmp_path / "run/model.safetensors")
    groups = loaded.model.groups
    assert groups is not None
    assert groups.names == ("square",)
    assert loaded.model.anchors.group is not None
    assert set(loaded.model.anchors.group.tolist()) == {-1, 0}
    start, end = (
        loaded.frame.origin_m + loaded.frame.unit_m * groups.pose(t).position[0].detach().numpy() for t in (0.0, 1.0)
    )
    np.testing.assert_allclose((end - start)[:2], square_centre(1) - square_centre(0), atol=1.0)
    assert load_model(tmp_path / "run/coarse.safetensors").model.groups is None


def test_a_run_whose_tracks_are_gone_says_so(toy: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    train(read_capture(toy), out, RIDING, silent)
    (out / "model.safetensors").unlink()
    tracks_path(out).unlink()
    with pytest.raises(InputError, match="the run's tracks are missing; delete the run and train again"):
        train(read_capture(toy), out, RIDING, silent)


def test_membership_asks_only_where_it_is_certain() -> None:
    share = torch.tensor([[1.0, 0.5, 0.25, 0.0]])
    labels = torch.tensor([[True, False, False, True]])
    moving = torch.tensor([[True, True, False, True]])
    assert membership_loss(share, labels, moving).item() == pytest.approx((0 + 0.25 + 1) / 3)


@pytest.mark.parametrize(("look", "number"), [(1, signal.SIGINT), (2, signal.SIGTERM)])
def test_a_search_for_movers_stops_at_once_and_is_repeated(
    toy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, look: int, number: signal.Signals
) -> None:
    config = replace(RIDING, motion=MotionSettings(tracks="pictures", clean_iterations=10))
    looks: list[int] = []

    def find(_settings: object, capture: Capture, *_: object) -> Tracks:
        looks.append(len(looks))
        if len(looks) == look:
            os.kill(os.getpid(), number)
            time.sleep(60)  # a search that looks at no flag
        return truth_tracks(capture, capture.of_split("train"))

    monkeypatch.setattr(movers, "find", find)
    started = time.monotonic()
    with pytest.raises(Interrupted, match="stopped while looking for movers; the same command looks again"):
        train(read_capture(toy), tmp_path / "parts", config, silent)
    assert time.monotonic() - started < 55
    train(read_capture(toy), tmp_path / "parts", config, silent)
    assert len(looks) == 3, "what the first look had found is kept"
    train(read_capture(toy), tmp_path / "whole", config, silent)
    whole, parts = (load_model(tmp_path / name / "model.safetensors").model.state_dict() for name in ("whole", "parts"))
    for name, value in whole.items():
        assert torch.equal(value, parts[name]), name


def test_other_motion_settings_make_another_run(toy: Path, tmp_path: Path) -> None:
    train(read_capture(toy), tmp_path / "run", RIDING, silent)
    other = replace(RIDING, motion=MotionSettings(tracks="truth", voxel_px=3.0))
    with pytest.raises(InputError, match=r"another training.motion.voxel_px"):
        train(read_capture(toy), tmp_path / "run", other, silent)


def test_another_runs_tracks_are_refused(toy: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    train(read_capture(toy), out, RIDING, silent)
    (out / "model.safetensors").unlink()
    own = load_tracks(tracks_path(out))
    save_tracks(tracks_path(out), replace(own, names=("another",)))
    with pytest.raises(InputError, match="is of another run than the checkpoint beside it"):
        train(read_capture(toy), out, RIDING, silent)
    save_tracks(tracks_path(out), replace(own, labels=own.labels[1:], moving=own.moving[1:]))
    with pytest.raises(InputError, match="holds tracks of another capture"):
        train(read_capture(toy), out, RIDING, silent)


@pytest.mark.parametrize("source", ["truth", "boxes"])
def test_a_capture_without_the_tracks_asked_for_is_refused_before_anything_is_written(
    toy: Path, tmp_path: Path, source: str
) -> None:
    capture = replace(read_capture(toy), tracks=None)
    with pytest.raises(InputError, match="use --tracks pictures"):
        train(capture, tmp_path / "run", replace(RIDING, motion=MotionSettings(tracks=source)), silent)
    assert not (tmp_path / "run").exists()


def test_a_run_of_the_other_kind_is_refused_in_the_commands_own_words(toy: Path, tmp_path: Path) -> None:
    train(read_capture(toy), tmp_path / "run", RIDING, silent)
    with pytest.raises(InputError, match="holds a run of --motion tracks, and --motion none is asked for"):
        train(read_capture(toy), tmp_path / "run", SHORT, silent)


def test_true_movers_that_no_training_frame_shows_do_not_ride(toy: Path) -> None:
    capture = read_capture(toy)
    with np.load(toy / "truth/tracks.npz") as file:
        arrays = dict(file)
    kept = (toy / "truth/tracks.npz").read_bytes()
    try:
        for changed in ({"instance_id": np.array([9], np.uint32)}, {"moving": np.zeros_like(arrays["moving"])}):
            np.savez(toy / "truth/tracks.npz", **(arrays | changed))
            assert len(truth_tracks(capture, capture.of_split("train"))) == 0
        np.savez(toy / "truth/tracks.npz", **(arrays | {"object_to_world": 3 * arrays["object_to_world"]}))
        with pytest.raises(InputError, match="must hold rigid motions"):
            truth_tracks(capture, capture.of_split("train"))
    finally:
        (toy / "truth/tracks.npz").write_bytes(kept)


def test_rates_of_what_does_not_ride_are_refused(toy_capture: Path, tmp_path: Path) -> None:
    rates = replace(SHORT.rates, heading=Decay(0.5, 0.05))
    with pytest.raises(InputError, match=r"rates\.heading: nothing rides"):
        train(read_capture(toy_capture), tmp_path / "run", replace(SHORT, rates=rates), silent)
    assert not (tmp_path / "run").exists()
