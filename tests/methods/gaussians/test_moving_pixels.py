"""A short training of methods whose network moves free Gaussians shows a moving square far better than standing."""

from dataclasses import replace
from pathlib import Path

import pytest

from aa4d.capture.reader import read_capture
from aa4d.methods import method_of
from aa4d.methods.d3dgs.settings import D3DGSSettings
from aa4d.methods.grid4d.settings import Grid4DSettings
from aa4d.methods.settings import Decay, RunSettings, with_iterations
from aa4d.training.trainer import train
from tests.methods.test_moving_pixels import moving_psnr
from tests.toy_capture import write_toy_capture


def short(name: str) -> RunSettings:
    settings = replace(with_iterations(method_of(name).presets["quick"], 100, 300), checkpoint_every=10_000)
    if isinstance(settings, D3DGSSettings):
        rates = replace(settings.rates, deformation=Decay(5e-3, 5e-5))
        return replace(settings, voxel_px=1.0, model=replace(settings.model, width=128), rates=rates)
    if isinstance(settings, Grid4DSettings):
        grids = replace(settings.model, place_levels=4, place_finest=64, time_levels=4, time_finest=64, width=64)
        rates = replace(settings.rates, deformation=Decay(5e-3, 5e-5), grids=Decay(5e-2, 5e-4))
        return replace(settings, model=grids, rates=rates)
    return settings


@pytest.mark.parametrize("name", ["d3dgs", "fourdgs", "grid4d", "speede"])
def test_it_beats_its_static_stage_by_three_decibels_on_moving_pixels(name: str, tmp_path: Path) -> None:
    capture = read_capture(write_toy_capture(tmp_path / "capture", frames=24, travel_m=4))
    train(capture, tmp_path / "run", short(name), lambda *_: None)
    static = moving_psnr(tmp_path / "run/coarse.safetensors", capture)
    moving = moving_psnr(tmp_path / "run/model.safetensors", capture)
    assert moving > static + 3, (static, moving)
