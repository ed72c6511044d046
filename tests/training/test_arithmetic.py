"""The networks' arithmetic is a setting of training: off by default, kept over a stop, refused where useless."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from aa4d.capture.reader import read_capture
from aa4d.errors import InputError
from aa4d.field.mlp import TwoLayer
from aa4d.methods import METHODS, method_of, presets_of
from aa4d.methods.model_file import load_model
from aa4d.training.frames import training_frames
from aa4d.training.trainer import Run, description_of, train
from tests.toy_run import BRIEF, silent

ROUNDED = replace(BRIEF, arithmetic="bfloat16")


def arithmetic_of(model: torch.nn.Module) -> set[str]:
    return {module.arithmetic for module in model.modules() if isinstance(module, TwoLayer)}


def test_a_run_multiplies_in_its_arithmetic_from_the_start_and_from_a_checkpoint(toy_run: Path, tmp_path: Path) -> None:
    capture = read_capture(toy_run.parent / "capture")
    settings = method_of(BRIEF.method).resolved(ROUNDED, len(capture.frames))
    run = Run(training_frames(capture, torch.device("cpu")), tmp_path / "run", settings)
    assert arithmetic_of(run.initial_state().model) == {"bfloat16"}
    path = train(capture, tmp_path / "run", ROUNDED, silent)
    assert arithmetic_of(run.last_good_state().model) == {"bfloat16"}
    rounded, exact = load_model(path), load_model(toy_run / "model.safetensors")
    assert arithmetic_of(rounded.model) == {"float32"}  # evaluated and filmed as exactly as any other
    assert rounded.identity != exact.identity
    ours, theirs = (dict(loaded.model.named_parameters())["decoder.color.output.weight"] for loaded in (rounded, exact))
    assert not torch.equal(ours, theirs)
    assert (ours - theirs).norm() < 0.1 * theirs.norm()


def test_the_default_leaves_runs_of_before_as_they_were(toy_run: Path, tmp_path: Path) -> None:
    capture = read_capture(toy_run.parent / "capture")
    assert "arithmetic" not in description_of(capture, BRIEF)["training"]
    assert description_of(capture, ROUNDED)["training"]["arithmetic"] == "bfloat16"
    shutil.copytree(toy_run, tmp_path / "run")
    with pytest.raises(InputError, match="holds a run with another training"):
        train(capture, tmp_path / "run", ROUNDED, silent)


@pytest.mark.parametrize("name", METHODS)
def test_methods_without_such_networks_refuse_it(name: str) -> None:
    preset = presets_of(name)["quick"]
    if preset.has_two_layer:
        assert replace(preset, arithmetic="bfloat16").arithmetic == "bfloat16"
    else:
        with pytest.raises(ValueError, match=f"arithmetic must be float32, for the networks of {name} know no other"):
            replace(preset, arithmetic="bfloat16")
