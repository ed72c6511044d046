"""Exposures that are learned with the scene."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from aa4d.capture.reader import read_capture
from aa4d.evaluation.evaluate import evaluate
from aa4d.methods.model_file import load_model
from aa4d.methods.rendering import exposed
from aa4d.methods.settings import Decay
from aa4d.training.exposures import Exposures, with_exposures
from aa4d.training.trainer import description_of, train
from tests.toy_run import BRIEF, silent

RATE = Decay(1e-2, 1e-2)
LEARNING = replace(
    BRIEF,
    coarse_iterations=240,
    fine_iterations=40,
    exposure=True,
    rates=replace(BRIEF.rates, exposures=Decay(5e-3, 1e-3)),
)


def darken(folder: Path) -> np.ndarray:
    """The frames of a capture as a camera takes them whose exposure falls by a third; the gain of each, [N]."""
    gains = np.linspace(1.0, 0.67, 10)
    for index, gain in enumerate(gains):
        path = folder / f"frames/{index:06}.png"
        pixels = np.asarray(Image.open(path)).astype(np.float64) * gain
        Image.fromarray(pixels.round().astype(np.uint8)).save(path)
    return gains


def test_exposures_of_a_darkening_clip_are_found_and_held_out_frames_gain(toy_capture: Path, tmp_path: Path) -> None:
    gains = darken(toy_capture)
    capture = read_capture(toy_capture)
    train(capture, tmp_path / "with", LEARNING, silent)
    train(capture, tmp_path / "without", replace(LEARNING, exposure=False), silent)
    frames = load_model(tmp_path / "with/model.safetensors").frames
    maps = np.stack([frame.exposure for frame in frames if frame.exposure is not None])
    assert len(maps) == 10, "held-out frames have those between their neighbors"
    train_ranks = capture.of_split("train")
    assert np.allclose(maps[train_ranks].mean(0), np.eye(3, 4), atol=1e-6)
    brightness = (maps @ np.array([0.5, 0.5, 0.4, 1.0])).mean(1)  # of the plane's mean color
    ratio = brightness[train_ranks] / brightness[train_ranks].mean()
    assert np.allclose(ratio, gains[train_ranks] / gains[train_ranks].mean(), atol=0.05)
    scores = {name: evaluate(tmp_path / name, toy_capture, silent) for name in ("with", "without")}
    assert scores["with"].psnr_still is not None
    assert scores["without"].psnr_still is not None
    assert scores["with"].psnr_still > scores["without"].psnr_still + 2


def test_a_map_is_applied_as_written() -> None:
    exposure = torch.tensor([[0.5, 0.0, 0.1, 0.01], [0.0, 2.0, 0.0, 0.02], [0.0, 0.0, 1.0, 0.0]])
    assert exposed(torch.tensor([0.4, 0.2, 0.1]), exposure).tolist() == pytest.approx([0.22, 0.42, 0.1])


def test_all_views_together_keep_the_identity() -> None:
    exposures = Exposures(4, RATE, torch.device("cpu"))
    exposures.set_to(exposures.stacked() * torch.tensor([0.5, 0.6, 0.7, 0.9])[:, None, None] + 0.1)
    before = exposures.stacked()
    exposures.fix_gauge()
    torch.testing.assert_close(exposures.stacked().mean(0), torch.eye(3, 4))
    torch.testing.assert_close(exposures.stacked()[0] - exposures.stacked()[1], before[0] - before[1])


def test_a_checkpoint_brings_back_every_number() -> None:
    exposures, again = (Exposures(3, RATE, torch.device("cpu")) for _ in range(2))
    for index in (1, 1, 2):
        exposures.of_views[index].sum().backward()
        exposures.step(0.5)
    again.load(exposures.tensors())
    for one in (exposures, again):
        one.of_views[2].square().sum().backward()
        one.step(0.6)
    assert torch.equal(exposures.stacked(), again.stacked())
    assert torch.equal(exposures.stacked()[0], torch.eye(3, 4)), "a view that is not drawn stays"


def test_held_out_frames_have_the_map_between_their_neighbors(toy_capture: Path) -> None:
    capture = read_capture(toy_capture)
    values = np.arange(8.0)[:, None, None] * np.ones((8, 3, 4))
    frames = with_exposures(capture, values).frames
    train_ranks = capture.of_split("train")
    assert [frames[i].exposure[0, 0] for i in train_ranks] == pytest.approx(range(8))
    assert frames[8].exposure[0, 0] == pytest.approx(6.5)
    assert frames[0].exposure[0, 0] == 0.0, "before the first training frame its own"


def test_a_run_without_is_described_as_ever(toy_capture: Path) -> None:
    capture = read_capture(toy_capture)
    described = json.dumps(description_of(capture, BRIEF))
    assert "exposure" not in described
    assert "exposure" in json.dumps(description_of(capture, LEARNING))
