"""Model files of MoDec-GS, SD-GS and 4D-SFGS: every variant is read back, and a damaged header is one sentence."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import save_file

from aa4d.capture.frame import frame_of
from aa4d.capture.reader import read_capture
from aa4d.errors import InputError
from aa4d.methods.modec.model import Config
from aa4d.methods.modec.model import blank_model as blank_modec
from aa4d.methods.modec.settings import FieldConfig
from aa4d.methods.modec.settings import ModelConfig as ModecConfig
from aa4d.methods.model_file import load_model, read_tensors, save_model
from aa4d.methods.scene_model import SceneModel
from aa4d.methods.sdgs.model import blank_model as blank_sdgs
from aa4d.methods.sdgs.settings import ModelConfig as SdgsConfig
from aa4d.methods.sfgs.model import blank_model as blank_sfgs
from aa4d.methods.sfgs.settings import ModelConfig as SfgsConfig


def modec(**switches: Any) -> SceneModel:
    field = FieldConfig(3, (4, 5), 6, 7)
    return blank_modec(Config(ModecConfig(offsets=2, feature_dim=5, **switches), field, field), 3)


def sdgs() -> SceneModel:
    sizes = SdgsConfig(offsets=2, feature_dim=5, decoder_hidden=6, time_frequencies=3, plane_dim=3, width=7)
    return blank_sdgs(replace(sizes, spatial_resolutions=(4, 5), temporal_resolution=6), 3)


def sfgs() -> SceneModel:
    return blank_sfgs(SfgsConfig(offsets=2, feature_dim=5, decoder_hidden=6, beta=3.0, fastest=0.5), 3)


def write(path: Path, method: str, model: SceneModel, folder: Path) -> Path:
    capture = read_capture(folder)
    training, background = {"seconds": 1.0}, (0.1, 0.2, 0.3)
    frame = frame_of(capture)
    save_model(
        path, method, model, is_static=False, capture=capture, frame=frame, background=background, training=training
    )
    return path


@pytest.mark.parametrize(
    ("method", "model"),
    [
        ("modec", modec()),
        ("modec", modec(gates=False, intervals=3)),
        ("modec", modec(gad=False)),
        ("modec", modec(gad=False, lgd="anchors")),
        ("modec", modec(lgd="none")),
        ("sdgs", sdgs()),
        ("sfgs", sfgs()),
    ],
    ids=["modec", "no gates", "local", "anchors", "global", "sdgs", "sfgs"],
)
def test_every_variant_is_read_back_whole(method: str, model: SceneModel, toy_capture: Path, tmp_path: Path) -> None:
    torch.manual_seed(0)
    for parameter in model.parameters():
        torch.nn.init.normal_(parameter)
    loaded = load_model(write(tmp_path / "model.safetensors", method, model, toy_capture)).model
    assert loaded.state_dict().keys() == model.state_dict().keys()
    assert all(torch.equal(value, loaded.state_dict()[name]) for name, value in model.state_dict().items())
    camera = frame_of(read_capture(toy_capture)).camera(torch.eye(4).numpy(), torch.eye(3).numpy(), 8, 8)
    with torch.no_grad():
        was, now = model.gaussians(0.6, camera), loaded.gaussians(0.6, camera)
    assert torch.equal(was.means, now.means)
    assert torch.equal(was.opacities, now.opacities)


@pytest.mark.parametrize(
    ("method", "change", "says"),
    [
        ("modec", lambda c, _: c.update(lgd="both"), "the header's config is wrong"),
        ("modec", lambda c, _: c.update(gad=1), "the header's config is wrong"),
        ("modec", lambda c, _: c.update(intervals=0), "the header's config is wrong"),
        ("modec", lambda c, _: c.update(gad=False, lgd="none"), "nothing moves"),
        ("modec", lambda c, _: c.pop("gates"), "the header's config is wrong"),
        ("modec", lambda _, t: t.pop("gad.field.planes.1.xt"), "'gad.field.planes.1.xt' is missing"),
        ("modec", lambda _, t: t.pop("anchors.dynamics"), "'anchors.dynamics' is missing"),
        ("modec", lambda _, t: t.update({"lgd.field.planes.0.zt": torch.zeros(3, 3)}), "config is wrong"),
        ("sdgs", lambda c, _: c.update(time_frequencies=40), "the header's config is wrong"),
        ("sdgs", lambda _, t: t.pop("deformation.field.planes.0.xt"), "xt' is missing"),
        ("sfgs", lambda c, _: c.update(beta=0.5), "the header's config is wrong"),
        ("sfgs", lambda c, _: c.update(fastest="fast"), "the header's config is wrong"),
        ("sfgs", lambda _, t: t["clip_s"].zero_(), "clip_s or frame_s is not above 0"),
        ("sfgs", lambda _, t: t.update({"anchors.position": torch.zeros(3, 3)}), "do not fit"),
    ],
)
def test_what_no_training_wrote_is_refused_in_one_sentence(
    method: str,
    change: Callable[[dict[str, Any], dict[str, torch.Tensor]], Any],
    says: str,
    toy_capture: Path,
    tmp_path: Path,
) -> None:
    model = {"modec": modec, "sdgs": sdgs, "sfgs": sfgs}[method]()
    path = write(tmp_path / "model.safetensors", method, model, toy_capture)
    header, tensors = read_tensors(path)
    change(header["config"], tensors)
    save_file(tensors, str(path), metadata={"aa4d": json.dumps(header)})
    with pytest.raises(InputError, match=says) as refused:
        load_model(path)
    assert "\n" not in str(refused.value)
