"""What a run shows: its model, its checkpoint while it trains, and again when there is more."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from aa4d.capture.reader import read_capture
from aa4d.errors import InputError
from aa4d.training.trainer import train
from aa4d.viewer.following import Followed
from tests.toy_run import BRIEF, silent


class Stop(Exception):  # noqa: N818, it is no error
    pass


@pytest.fixture
def run(toy_run: Path, tmp_path: Path) -> Path:
    """A copy that a test may change."""
    return Path(shutil.copytree(toy_run, tmp_path / "run"))


def test_a_finished_run_shows_its_model_and_has_no_news(toy_run: Path) -> None:
    followed = Followed(toy_run, None)
    shown = followed.load()
    assert shown.loaded.path == toy_run / "model.safetensors"
    assert shown.state == "trained, 20 iterations"
    assert shown.footage is not None
    assert followed.news() is None


def test_a_run_that_trains_shows_its_last_checkpoint_and_then_the_next(toy_run: Path, tmp_path: Path) -> None:
    capture, out = read_capture(toy_run.parent / "capture"), tmp_path / "run"
    settings = replace(BRIEF, preset="quick", checkpoint_every=8)

    def until(iteration: int) -> None:
        def progress(stage: str, done: int, *_: object) -> None:
            if stage == "fine" and done == iteration:
                raise Stop

        with pytest.raises(Stop):
            train(capture, out, settings, progress)

    until(10)
    followed = Followed(out, None)
    shown = followed.load()
    assert shown.state == "training: fine, iteration 8 of 20"
    assert shown.loaded.path == out / "checkpoint.safetensors"
    assert shown.footage is not None
    assert followed.news() is None
    until(18)
    further = followed.news()
    assert further is not None
    assert further.state == "training: fine, iteration 16 of 20"
    train(capture, out, settings, silent)
    done = followed.news()
    assert done is not None
    assert done.state == "trained, 20 iterations"
    with torch.no_grad():
        moved = done.loaded.model.centers(1.0) - further.loaded.model.centers(1.0)
    assert moved.abs().max() > 0


def test_a_capture_that_is_gone_leaves_the_model(run: Path) -> None:
    assert Followed(run, None).load().footage is None  # it was beside the run that this is a copy of
    with pytest.raises(InputError, match="no such capture folder"):
        Followed(run, run / "absent").load()


def test_what_has_nothing_to_show_says_so(run: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="absent: no such folder"):
        Followed(tmp_path / "absent", None).load()
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="empty: holds no model; name the folder of a run"):
        Followed(tmp_path / "empty", None).load()
    (run / "model.safetensors").unlink()
    (run / "checkpoint.safetensors").unlink()
    with pytest.raises(InputError, match="run: its training has written no checkpoint yet"):
        Followed(run, None).load()


@pytest.mark.parametrize("kept", [0, 100, 5000])
def test_a_damaged_model_is_refused(run: Path, kept: int) -> None:
    whole = (run / "model.safetensors").read_bytes()
    (run / "model.safetensors").write_bytes(whole[:kept])
    with pytest.raises(InputError, match=r"model\.safetensors: not a whole safetensors file"):
        Followed(run, None).load()


def test_damage_that_comes_later_is_told_once(run: Path) -> None:
    followed = Followed(run, None)
    followed.load()
    (run / "model.safetensors").write_bytes(b"half a file")
    with pytest.raises(InputError, match="not a whole safetensors file"):
        followed.news()
    assert followed.news() is None
