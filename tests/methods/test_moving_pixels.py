"""A short training of each of these methods shows a moving square far better than its own static stage."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from aa4d.capture.reader import Capture, read_capture, read_images
from aa4d.evaluation.views import view_of_frame
from aa4d.methods import method_of
from aa4d.methods.modec.settings import ModecSettings
from aa4d.methods.model_file import load_model
from aa4d.methods.rendering import render
from aa4d.methods.settings import RunSettings, with_iterations
from aa4d.training.trainer import train
from tests.toy_capture import write_toy_capture


def short(name: str) -> RunSettings:
    settings = replace(with_iterations(method_of(name).presets["quick"], 60, 150), checkpoint_every=10_000)
    if not isinstance(settings, ModecSettings):
        return settings
    small = replace(settings.local_field, spatial_resolutions=(16, 32), width=32)
    return replace(settings, local_field=small, global_field=replace(small, spatial_resolutions=(16,)))


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


@pytest.mark.parametrize("name", ["adaanchor4d", "modec", "sdgs", "sfgs"])
def test_it_beats_its_static_stage_by_three_decibels_on_moving_pixels(name: str, tmp_path: Path) -> None:
    capture = read_capture(write_toy_capture(tmp_path / "capture", frames=24, travel_m=4))
    progress: Callable[..., None] = lambda *_: None  # noqa: E731
    train(capture, tmp_path / "run", short(name), progress)
    static = moving_psnr(tmp_path / "run/coarse.safetensors", capture)
    moving = moving_psnr(tmp_path / "run/model.safetensors", capture)
    assert moving > static + 3, (static, moving)
