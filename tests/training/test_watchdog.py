"""A first NaN is named: the group it stands in and the iteration, from the last checkpoint on."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from safetensors import safe_open

from aa4d.capture.reader import read_capture
from aa4d.errors import InputError
from aa4d.methods.adaanchor4d.method import AdaAnchor4DMethod
from aa4d.methods.adaanchor4d.settings import LearningRates
from aa4d.methods.settings import Decay
from aa4d.training import trainer
from aa4d.training.trainer import train
from tests.training.short_run import OFTEN_SAVED, SHORT


def silent(*_: object) -> None:
    pass


def all_finite(checkpoint: Path) -> bool:
    with safe_open(str(checkpoint), framework="pt") as file:
        return all(torch.isfinite(file.get_tensor(name)).all() for name in file.keys())  # noqa: SIM118, not a dict


def test_a_diverging_group_is_named_with_its_first_iteration(toy_capture: Path, tmp_path: Path) -> None:
    rates = replace(LearningRates(), planes=Decay(1e39, 1e39))
    with pytest.raises(InputError, match=r"a parameter of 'planes' at fine iteration 1; lower the learning rate of 'p"):
        train(read_capture(toy_capture), tmp_path / "run", replace(SHORT, rates=rates), silent)
    assert all_finite(tmp_path / "run/checkpoint.safetensors")


@pytest.mark.parametrize("at", [3, 8, 21])
def test_a_gradient_that_nothing_shows_is_found_at_the_next_checkpoint_and_traced_back(
    toy_capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at: int
) -> None:
    """An anchor that no camera sees again turns NaN: no later loss would ever tell."""
    step = trainer.Run.step

    def poisoned(self: trainer.Run, state: trainer.TrainingState, watch: trainer.Watch | None = None) -> object:
        hook = None
        if (state.stage, state.iteration + 1) == ("fine", at):
            hook = state.model.dlgd_scale.output.bias.register_hook(lambda g: torch.full_like(g, torch.nan))
        try:
            return step(self, state, watch)
        finally:
            if hook:
                hook.remove()
                with torch.no_grad():  # out of sight: only the moments keep the NaN
                    state.model.dlgd_scale.output.bias.nan_to_num_()

    monkeypatch.setattr(trainer.Run, "step", poisoned)
    said: list[str] = []
    with pytest.raises(InputError, match=f"a gradient of 'deformation' at fine iteration {at};"):
        train(read_capture(toy_capture), tmp_path / "run", OFTEN_SAVED, silent, say=said.append)
    assert "to see why" in said[-1]
    assert all_finite(tmp_path / "run/checkpoint.safetensors")


def test_a_loss_without_a_culprit_blames_the_input(
    toy_capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    loss = AdaAnchor4DMethod.image_loss
    monkeypatch.setattr(AdaAnchor4DMethod, "image_loss", lambda *a: (loss(*a)[0] * torch.nan, torch.zeros(())))
    with pytest.raises(InputError, match=r"in the loss at coarse iteration 1; check the poses .* nothing is kept"):
        train(read_capture(toy_capture), tmp_path / "run", SHORT, silent)
