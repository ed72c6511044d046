"""CUDA without a GPU: tensors that only have a device and a shape show whether everything is made where it belongs."""

import subprocess
import sys
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor, nn
from torch._subclasses.fake_tensor import FakeTensorMode

from aa4d.anchors.densification import Statistics
from aa4d.capture.reader import read_capture
from aa4d.device import choose_device, note_on_device
from aa4d.errors import InputError
from aa4d.evaluation.views import view_of_frame
from aa4d.methods import METHODS, method_of, presets_of
from aa4d.methods.adaanchor4d.settings import ModelConfig
from aa4d.methods.adaanchor4d.warping import density_adaptive_boundaries
from aa4d.methods.model_file import load_model
from aa4d.methods.settings import with_iterations
from aa4d.raster.types import Camera, Gaussians, Rendering
from aa4d.training.frames import training_frames
from aa4d.training.optimiser import make_optimiser, set_rates
from aa4d.training.trainer import Run, train
from tests.training.short_run import SHORT

# A device that this PyTorch always has, and that fake tensors mix with the CPU as little as they do CUDA.
OTHER = torch.device("meta")


def blurred(gaussians: Gaussians, camera: Camera, *, background: Tensor, outputs: Collection[str]) -> Rendering:
    """Stands for the rasteriser: every input reaches every pixel."""
    assert set(outputs) <= {"absolute_gradient"}
    mean = sum(value.mean() for value in vars(gaussians).values() if value is not None)
    color = (mean + background + camera.viewmat.sum() + camera.K.sum()).expand(camera.height, camera.width, 3)
    radii = gaussians.opacities.detach().int()
    gathered = gaussians.opacities.detach()
    return Rendering(color, color[..., 0], None, radii, gathered, gathered if outputs else None)


def some_rows(tensor: Tensor) -> Tensor:
    """Stands for `Tensor.nonzero` of [N], whose shape depends on values: half of the rows, as either of two windows."""
    return torch.arange(len(tensor) // 2, device=tensor.device)[:, None]


def moved(module: nn.Module, device: torch.device) -> nn.Module:
    """`Module.to`, which cannot exchange fake tensors in place."""
    for part in module.modules():
        for name, parameter in list(part.named_parameters(recurse=False)):
            setattr(part, name, nn.Parameter(parameter.detach().to(device)))
        for name, buffer in list(part.named_buffers(recurse=False)):
            setattr(part, name, buffer.to(device))
    return module


@pytest.mark.parametrize("stage", ["coarse", "fine"])
def test_what_a_training_step_computes_mixes_no_devices(
    toy_capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stage: str
) -> None:
    monkeypatch.setattr("aa4d.methods.rendering.rasterize", blurred)
    monkeypatch.setattr(
        "aa4d.methods.scene_model.in_view", lambda position, *_: torch.arange(len(position), device=position.device)
    )
    monkeypatch.setattr(nn.Module, "to", moved)
    capture = read_capture(toy_capture)
    with FakeTensorMode(allow_non_fake_inputs=True):
        settings = replace(SHORT, model=ModelConfig(spatial_resolutions=(4,), temporal_resolution=4))
        run = Run(training_frames(capture, OTHER), tmp_path, settings)
        state = run.initial_state()
        state.stage = stage
        state.optimiser = make_optimiser(state.model, SHORT.rates, canonical=stage == "coarse")
        set_rates(state.optimiser, 0.5)
        rendered, loss, squared_error = run._view_loss(state, run.schedule[stage], 0)
        if (penalty := run.method.penalty(run.schedule[stage], state.model, settings)) is not None:
            loss = loss + penalty
        loss.backward()
        state.statistics.add(rendered.visible, rendered.gaussians, rendered.rendering)
        u = state.model.field.normalise(state.model.anchors.position)
        assert density_adaptive_boundaries(u, 64, 1.5, 1.0, 0.2, 0.8).device == OTHER
        assert isinstance(state.statistics, Statistics)
        assert {v.device for v in vars(state.statistics).values()} == {OTHER}
        assert loss.device == squared_error.device == rendered.rendering.color.device == OTHER
        for group in state.optimiser.param_groups:
            for parameter in group["params"]:
                assert parameter.device == OTHER
                assert parameter.grad is None or parameter.grad.device == OTHER


@pytest.mark.parametrize("name", METHODS)
def test_no_methods_first_moving_step_mixes_devices(
    toy_capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr("aa4d.methods.rendering.rasterize", blurred)
    monkeypatch.setattr(
        "aa4d.methods.scene_model.in_view", lambda position, *_: torch.arange(len(position), device=position.device)
    )
    monkeypatch.setattr(nn.Module, "to", moved)
    # What a fake tensor does not tell: the degree of harmonics, the length of a clip, a phase, which rows are drawn.
    monkeypatch.setattr(Tensor, "__int__", lambda _: 2)
    monkeypatch.setattr(Tensor, "__float__", lambda _: 1.0)
    monkeypatch.setattr(Tensor, "__bool__", lambda _: False)
    monkeypatch.setattr(Tensor, "nonzero", some_rows)
    capture = read_capture(toy_capture)
    method = method_of(name)
    settings = method.resolved(with_iterations(presets_of(name)["quick"], 20, 20), len(capture.frames))
    with FakeTensorMode(allow_non_fake_inputs=True):
        run = Run(training_frames(capture, OTHER), tmp_path, settings)
        state = run.initial_state()
        stage = run.schedule.first_moving
        method.enter(stage, state.model, settings)
        state.stage, state.optimiser = stage.name, make_optimiser(state.model, settings.rates, canonical=False)
        method.begin_step(stage, 0, state.model, settings)
        rendered, loss, _ = run._view_loss(state, stage, 0)
        if (penalty := method.penalty(stage, state.model, settings)) is not None:
            loss = loss + penalty
        loss.backward()
        method.observe(state.statistics, rendered, 1, settings)
        learned = [parameter for parameter in state.model.parameters() if parameter.grad is not None]
        assert learned
        assert {value.device for value in state.model.state_dict().values()} == {OTHER}
        assert {parameter.grad.device for parameter in learned} | {loss.device} == {OTHER}
        assert {value.device for value in vars(state.statistics).values()} == {OTHER}


def test_evaluation_views_a_frame_where_the_model_lies(toy_capture: Path, tmp_path: Path) -> None:
    capture = read_capture(toy_capture)
    train(capture, tmp_path / "run", replace(SHORT, coarse_iterations=1, fine_iterations=1), lambda *_: None)
    loaded = load_model(tmp_path / "run/model.safetensors", OTHER)
    assert {value.device for value in loaded.model.state_dict().values()} == {OTHER}
    _, camera, background = view_of_frame(loaded, capture, 0)
    assert camera.viewmat.device == camera.K.device == background.device == OTHER


def test_auto_is_the_cpu_and_says_so_where_a_gpu_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("aa4d.device.find_spec", lambda name: name)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    assert choose_device("auto") == torch.device("cpu")
    assert choose_device("cuda") == torch.device("cuda")
    assert "--device cuda" in (note_on_device("auto") or "")
    assert note_on_device("cuda") is None
    assert note_on_device("cpu") is None
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert note_on_device("auto") is None


def test_cuda_keeps_all_digits_of_convolutions(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("aa4d.device.find_spec", lambda name: name)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.backends.cudnn, "allow_tf32", True)
    choose_device("cpu")
    assert torch.backends.cudnn.allow_tf32
    choose_device("cuda")
    assert not torch.backends.cudnn.allow_tf32


def test_cuda_without_a_gpu_or_gsplat_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(InputError, match=r"finds no CUDA GPU here; .* use --device cpu"):
        choose_device("cuda")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr("aa4d.device.find_spec", lambda _: None)
    with pytest.raises(InputError, match="pip install gsplat"):
        choose_device("cuda")


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_a_missing_gpu_is_one_sentence_and_exit_code_2(toy_capture: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    command = [sys.executable, "-m", "aa4d.cli", "train", str(toy_capture), "--out", str(out), "--device", "cuda"]
    result = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert result.returncode == 2
    assert result.stderr.startswith("aa4d: --device cuda: PyTorch ")
    assert result.stderr.count("\n") == 1
    assert not out.exists()
