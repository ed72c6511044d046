"""A short training of methods whose network moves free Gaussians shows a moving square far better than standing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from aa4d.capture.reader import Capture, read_capture, read_images
from aa4d.evaluation.views import view_of_frame
from aa4d.methods import method_of
from aa4d.methods.d3dgs.settings import D3DGSSettings
from aa4d.methods.model_file import load_model
from aa4d.methods.rendering import render
from aa4d.methods.settings import Decay, with_iterations
from aa4d.training.trainer import train
from tests.toy_capture import write_toy_capture


def short(name: str) -> D3DGSSettings:
    settings = with_iterations(method_of(name).presets["quick"], 100, 300)
    assert isinstance(settings, D3DGSSettings)
    rates = replace(settings.rates, deformation=Decay(5e-3, 5e-5))
    model = replace(settings.model, width=128)
    return replace(settings, voxel_px=1.0, checkpoint_every=10_000, model=model, rates=rates)


def moving_psnr(path: Path, capture: Capture) -> float:
    """Of the square's pixels in the held-out frames within the clip, in dB."""
    loaded, errors = load_model(path), []
    for index in capture.of_split("test")[1:]:
        with torch.no_grad():
            color = render(loaded.model, *view_of_frame(loaded, capture, index)).rendering.color.numpy()
        truth = read_images(capture, [index])[0] / 255
        square = np.load(capture.folder / f"truth/{index:06}.npz")["instance_id"] > 0
        assert square.sum() > 10
        errors.append(np.square(color - truth)[square].mean())
    return float(-10 * np.log10(np.mean(errors)))


@pytest.mark.parametrize("name", ["d3dgs", "speede"])
def test_it_beats_its_static_stage_by_three_decibels_on_moving_pixels(name: str, tmp_path: Path) -> None:
    capture = read_capture(write_toy_capture(tmp_path / "capture", frames=24, travel_m=4))
    train(capture, tmp_path / "run", short(name), lambda *_: None)
    static = moving_psnr(tmp_path / "run/coarse.safetensors", capture)
    moving = moving_psnr(tmp_path / "run/model.safetensors", capture)
    assert moving > static + 3, (static, moving)
