"""Pixels that the loss does not see, and true depth."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from aa4d.capture.reader import read_capture
from aa4d.errors import InputError
from aa4d.evaluation.views import render_frame, view_of_frame
from aa4d.methods.model_file import load_model
from aa4d.methods.rendering import render
from aa4d.training.depth import depth_loss
from aa4d.training.trainer import description_of, train
from tests.toy_capture import ALTITUDE_M, HEIGHT, WIDTH
from tests.toy_run import BRIEF, silent

LEARNING = replace(BRIEF, coarse_iterations=150, fine_iterations=20)
LOGO = np.s_[2:10, 2:14]  # rows, columns


def burn_in(capture: Path) -> None:
    """A white logo in every frame, and its mask for all of them."""
    for path in (capture / "frames").glob("*.png"):
        pixels = np.array(Image.open(path))
        pixels[LOGO] = 255
        Image.fromarray(pixels).save(path)
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[LOGO] = 255
    (capture / "left_out").mkdir()
    Image.fromarray(mask).save(capture / "left_out/all.png")


def test_what_is_left_out_is_not_learned(toy_capture: Path, tmp_path: Path) -> None:
    clean = np.array(Image.open(toy_capture / "frames/000004.png")).astype(float)[LOGO]
    burn_in(toy_capture)
    capture = read_capture(toy_capture)
    errors = {}
    for leave_out in (True, False):
        train(capture, tmp_path / str(leave_out), replace(LEARNING, leave_out=leave_out), silent)
        picture = render_frame(load_model(tmp_path / str(leave_out) / "model.safetensors"), capture, 4)
        errors[leave_out] = float(np.abs(picture[LOGO] - clean).mean())
    assert errors[True] < 15
    assert errors[False] > 3 * errors[True]


def test_masks_that_are_not_there_or_do_not_fit_are_refused(toy_capture: Path, tmp_path: Path) -> None:
    settings = replace(LEARNING, leave_out=True)
    with pytest.raises(InputError, match=r"left_out: no training frame has a mask there; paint NAME.png"):
        train(read_capture(toy_capture), tmp_path / "run", settings, silent)
    (toy_capture / "left_out").mkdir()
    Image.new("L", (4, 4)).save(toy_capture / "left_out/000003.png")
    with pytest.raises(InputError, match=r"000003.png: mask has shape \(4, 4\), expected \(32, 48\)"):
        train(read_capture(toy_capture), tmp_path / "run", settings, silent)
    assert not (tmp_path / "run").exists()


def test_depth_that_is_learned_from_is_nearer_to_the_truth(toy_capture: Path, tmp_path: Path) -> None:
    capture = read_capture(toy_capture)
    errors = {}
    for weight in (0.0, 0.5):
        train(capture, tmp_path / str(weight), replace(LEARNING, true_depth=weight), silent)
        loaded = load_model(tmp_path / str(weight) / "model.safetensors")
        with torch.no_grad():
            depth = render(loaded.model, *view_of_frame(loaded, capture, 4), outputs=["depth"]).rendering.depth
        assert depth is not None
        errors[weight] = float((depth * loaded.frame.unit_m / ALTITUDE_M - 1).abs().mean())
    assert errors[0.5] < 0.7 * errors[0.0]


def test_true_depth_of_footage_is_refused(toy_capture: Path, tmp_path: Path) -> None:
    index = toy_capture / "capture.json"
    document = json.loads(index.read_text())
    for frame in document["frames"]:
        frame["truth"] = None
    index.write_text(json.dumps(document))
    with pytest.raises(InputError, match="has no true depth of all training frames; train without true_depth"):
        train(read_capture(toy_capture), tmp_path / "run", replace(LEARNING, true_depth=1.0), silent)


def test_the_error_of_depth_is_relative_and_skips_what_has_none() -> None:
    drawn = torch.tensor([[2.0, 0.0, 3.0, 1.0, 9.0]], requires_grad=True)
    true = torch.tensor([[4.0, 1.0, 2.0, torch.inf, 3.0]])
    ignored = torch.tensor([[False, False, False, False, True]])
    loss = depth_loss(drawn, true, ignored)
    assert loss.item() == pytest.approx((2 / 4 + 1 / 2) / 2)
    loss.backward()
    assert drawn.grad is not None
    assert drawn.grad.tolist() == [[pytest.approx(-1 / 8), 0.0, pytest.approx(1 / 4), 0.0, 0.0]]
    assert depth_loss(torch.zeros(1, 1), torch.ones(1, 1)).item() == 0.0


def test_a_run_without_either_is_described_as_ever(toy_capture: Path) -> None:
    described = json.dumps(description_of(read_capture(toy_capture), BRIEF))
    assert "leave_out" not in described
    assert "true_depth" not in described
