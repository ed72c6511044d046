"""Training on the toy capture: it learns, stops, continues, refuses."""

import json
import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from aa4d.capture.reader import read_capture
from aa4d.errors import InputError, Interrupted
from aa4d.evaluation.evaluate import evaluate
from aa4d.identity import Identity
from aa4d.model_file import load_model
from aa4d.training.trainer import train
from tests.toy_capture import write_toy_capture
from tests.training.short_run import SHORT


def silent(*_: object) -> None:
    pass


def never(*_: object) -> None:
    raise AssertionError("a finished run trains no further")


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A capture and a run that is long enough to have learned something."""
    folder = tmp_path_factory.mktemp("trained")
    capture = write_toy_capture(folder / "capture")
    config = replace(SHORT, coarse_iterations=150, fine_iterations=400)
    train(read_capture(capture), folder / "run", config, silent)
    return capture, folder / "run"


def test_the_fine_stage_learns_what_moves(trained: tuple[Path, Path]) -> None:
    _, run = trained
    metrics = evaluate(run, None, silent)
    assert metrics.psnr > 22
    assert metrics.psnr_dynamic is not None
    assert metrics.psnr_dynamic_static is not None
    assert metrics.psnr_dynamic > metrics.psnr_dynamic_static + 1
    assert [f.frame for f in metrics.frames] == ["000000", "000008"]
    written = json.loads((run / "metrics.json").read_text())
    assert written["psnr"] == metrics.psnr
    assert metrics.neural_mib * 2**20 == 4 * sum(
        p.numel() for p in load_model(run / "model.safetensors").model.networks_and_planes()
    )
    picture = np.asarray(Image.open(run / "eval/000008.png"))
    assert picture.shape == (32, 48, 3)


def test_another_capture_is_not_evaluated_on(trained: tuple[Path, Path], tmp_path: Path) -> None:
    other = write_toy_capture(tmp_path / "other", frames=9)
    with pytest.raises(InputError, match="is not the capture that"):
        evaluate(trained[1], other, silent)


def test_both_stages_are_files_of_their_own(trained: tuple[Path, Path]) -> None:
    _, run = trained
    assert load_model(run / "coarse.safetensors").is_static
    fine = load_model(run / "model.safetensors")
    assert not fine.is_static
    boundaries = fine.model.warp.boundaries
    assert (boundaries.diff() > 0).all()
    assert not torch.allclose(boundaries, torch.linspace(-1, 1, 65).expand(3, -1))


def test_a_finished_run_is_left_as_it_is(trained: tuple[Path, Path]) -> None:
    capture, run = trained
    config = replace(SHORT, coarse_iterations=150, fine_iterations=400)
    before = (run / "model.safetensors").stat().st_mtime_ns
    train(read_capture(capture), run, config, never)
    assert (run / "model.safetensors").stat().st_mtime_ns == before


def test_held_out_frames_are_never_read_in_training(toy_capture: Path, tmp_path: Path) -> None:
    (toy_capture / "frames/000008.png").unlink()
    train(read_capture(toy_capture), tmp_path / "run", SHORT, silent)
    with pytest.raises(InputError, match=r"000008\.png"):
        evaluate(tmp_path / "run", None, silent)


@pytest.mark.parametrize(
    ("stage", "at", "number"),
    [("coarse", 17, signal.SIGINT), ("coarse", 30, signal.SIGINT), ("fine", 23, signal.SIGTERM)],
)
def test_interrupted_and_continued_equals_uninterrupted(
    toy_capture: Path, tmp_path: Path, stage: str, at: int, number: signal.Signals
) -> None:
    capture = read_capture(toy_capture)
    train(capture, tmp_path / "whole", SHORT, silent)

    def interrupt(now: str, iteration: int, *_: object) -> None:
        if (now, iteration) == (stage, at):
            os.kill(os.getpid(), number)

    with pytest.raises(Interrupted, match=f"{stage} iteration {at}.*the same command continues"):
        train(capture, tmp_path / "parts", SHORT, interrupt)
    assert load_model(tmp_path / "parts/model.safetensors").is_static == (stage == "coarse")
    train(capture, tmp_path / "parts", SHORT, silent)
    whole = load_model(tmp_path / "whole/model.safetensors").model.state_dict()
    parts = load_model(tmp_path / "parts/model.safetensors").model.state_dict()
    for name, value in whole.items():
        assert torch.equal(value, parts[name]), name


def test_densification_changes_the_number_of_anchors(toy_capture: Path, tmp_path: Path) -> None:
    counts = set()
    # Growth fills empty voxels: they are to be smaller than the distance between the toy's points.
    train(read_capture(toy_capture), tmp_path / "run", replace(SHORT, voxel_px=0.4), lambda *a: counts.add(a[-1]))
    assert len(counts) > 1


def test_another_run_in_the_folder_is_refused(toy_capture: Path, tmp_path: Path) -> None:
    capture = read_capture(toy_capture)
    train(capture, tmp_path / "run", SHORT, silent)
    with pytest.raises(InputError, match=r"another training\.seed: 0 there, 1 asked for"):
        train(capture, tmp_path / "run", replace(SHORT, seed=1), silent)
    with pytest.raises(InputError, match="another capture"):
        train(replace(capture, identity=Identity("capture", "0")), tmp_path / "run", SHORT, silent)


def test_a_folder_with_other_things_is_refused_and_kept(toy_capture: Path, tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run/thesis.txt").write_text("mine")
    with pytest.raises(InputError, match="not empty"):
        train(read_capture(toy_capture), tmp_path / "run", SHORT, silent)
    assert [p.name for p in (tmp_path / "run").iterdir()] == ["thesis.txt"]


def test_an_unwritable_folder_is_refused(toy_capture: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot write there"):
        train(read_capture(toy_capture), tmp_path / "file" / "run", SHORT, silent)


def test_a_missing_training_image_is_refused_before_anything_is_written(toy_capture: Path, tmp_path: Path) -> None:
    (toy_capture / "frames/000003.png").unlink()
    with pytest.raises(InputError, match=r"000003\.png"):
        train(read_capture(toy_capture), tmp_path / "run", SHORT, silent)
    assert not (tmp_path / "run").exists()


def test_a_damaged_checkpoint_is_refused(toy_capture: Path, tmp_path: Path) -> None:
    capture = read_capture(toy_capture)
    train(capture, tmp_path / "run", SHORT, silent)
    checkpoint = tmp_path / "run/checkpoint.safetensors"
    checkpoint.write_bytes(checkpoint.read_bytes()[:1000])
    with pytest.raises(InputError, match="cannot continue from this checkpoint"):
        train(capture, tmp_path / "run", SHORT, silent)
