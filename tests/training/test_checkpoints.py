"""A checkpoint is what training wrote, or is refused: in shapes, types, values and position."""

import json
import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file
from torch import Tensor

from aa4d.capture.reader import read_capture
from aa4d.errors import InputError
from aa4d.methods import method_of
from aa4d.methods.settings import RunSettings
from aa4d.raster.types import Camera
from aa4d.training.checkpoints import load_checkpoint
from aa4d.training.poses import PoseRefinement
from aa4d.training.trainer import train
from tests.toy_capture import write_toy_capture
from tests.toy_run import BRIEF, silent
from tests.training.short_run import RIDING

POSES = replace(BRIEF, refine_poses=True)
Change = Callable[[dict[str, Any], dict[str, Tensor]], object]


@pytest.fixture(scope="module")
def finished(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, RunSettings]:
    """The checkpoint of a run, and its settings."""
    settings = {"paper": BRIEF, "poses": POSES, "riding": RIDING}[request.param]
    folder = tmp_path_factory.mktemp(request.param)
    capture = read_capture(write_toy_capture(folder / "capture"))
    train(capture, folder / "run", settings, silent)
    return folder / "run/checkpoint.safetensors", method_of(settings.method).resolved(settings, len(capture.frames))


def refusal(finished: tuple[Path, RunSettings], folder: Path, change: Change) -> str:
    """What is said to a copy of the checkpoint that was changed."""
    source, settings = finished
    with safe_open(str(source), framework="pt") as file:
        state = json.loads(file.metadata()["state"])
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    change(state, tensors)
    path = folder / "checkpoint.safetensors"
    save_file(tensors, str(path), metadata={"state": json.dumps(state)})
    camera = Camera(torch.eye(4), torch.eye(3), 4, 4)
    poses = PoseRefinement([camera] * 8, settings.rates.poses) if settings.refine_poses else None
    with pytest.raises(InputError) as caught:
        load_checkpoint(path, settings, torch.device("cpu"), poses)
    assert str(caught.value).startswith(f"{path}: cannot continue from this checkpoint (")
    return str(caught.value)


def of_kind(tensors: dict[str, Tensor], prefix: str) -> list[str]:
    return [name for name in tensors if name.startswith(prefix)]


@pytest.mark.parametrize("prefix", ["adam.exp_avg.", "adam.exp_avg_sq.", "adam.step.", "statistics."])
@pytest.mark.parametrize("finished", ["paper", "riding"], indirect=True)
@pytest.mark.parametrize(
    "spoilt",
    [
        lambda value: value.flatten()[:1].clone() if value.dim() else torch.zeros(2),
        lambda value: torch.cat([value, value]) if value.dim() else value[None],
        lambda value: value.double(),
        lambda value: torch.full_like(value, torch.nan),
    ],
    ids=["shorter", "longer", "float64", "NaN"],
)
def test_optimiser_state_and_statistics_of_another_kind_are_refused(
    finished: tuple[Path, RunSettings], tmp_path: Path, prefix: str, spoilt: Callable[[Tensor], Tensor]
) -> None:
    """A fused optimiser reads and writes beyond a moment that is shorter than its parameter."""

    def change(_: dict[str, Any], tensors: dict[str, Tensor]) -> None:
        name = max(of_kind(tensors, prefix), key=lambda name: tensors[name].numel())
        tensors[name] = spoilt(tensors[name])

    assert prefix in refusal(finished, tmp_path, change)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda s, _: s.update(stage="x"), "its stage is 'x', and this run has coarse, "),
        (lambda s, _: s.update(stage=None), "its stage is None"),
        (lambda s, _: s.update(stage=["fine"]), "its stage is "),
        (lambda s, _: s.update(iteration=None), "its iteration is None, and the fine stage has 20"),
        (lambda s, _: s.update(iteration="x"), "its iteration is 'x'"),
        (lambda s, _: s.update(iteration=-5), "its iteration is -5"),
        (lambda s, _: s.update(iteration=15.5), r"its iteration is 15\.5"),
        (lambda s, _: s.update(iteration=999), "its iteration is 999, and the fine stage has 20"),
        (lambda s, _: s.update(iteration=True), "its iteration is True"),
        (lambda s, _: s.update(iteration=10**400), "its iteration is 10000"),
        (lambda s, _: s.update(seconds="x"), "its seconds of training are 'x'"),
        (lambda s, _: s.update(seconds=None), "its seconds of training are None"),
        (lambda s, _: s.update(seconds=-5), "its seconds of training are -5"),
        (lambda s, _: s.update(seconds=math.nan), "its seconds of training are nan"),
        (lambda s, _: s.update(seconds=10**400), "its seconds of training are 10000"),
        (lambda s, _: s.pop("seconds"), "it lacks 'seconds'"),
        (lambda _, t: t.update({"adam.step.anchors.feature": torch.tensor(-1.0)}), "are negative"),
        (lambda _, t: t["adam.exp_avg_sq.anchors.feature"].sub_(1), "are negative"),
        (lambda _, t: t.pop("adam.exp_avg.anchors.feature"), "it lacks 'anchors.feature'"),
        (lambda _, t: [t.pop(name) for name in of_kind(t, "adam.")], "it lacks the optimizer's moments"),
        (lambda _, t: t.update({"adam.step.nobody": torch.tensor(1.0)}), "moments of nobody, which does not learn"),
        (lambda _, t: t.pop("statistics.drawn"), "it lacks 'drawn'"),
        (lambda _, t: t.update({"statistics.more": torch.zeros(1)}), "argument 'more'"),
        (lambda _, t: t["model.anchors.feature"].fill_(torch.inf), r"model\.anchors\.feature holds NaN or infinity"),
        (lambda _, t: t.update({"model.anchors.feature": torch.zeros(1, 1)}), "anchors.feature"),
    ],
)
@pytest.mark.parametrize("finished", ["paper"], indirect=True)
def test_what_no_training_wrote_is_refused(
    finished: tuple[Path, RunSettings], tmp_path: Path, change: Change, says: str
) -> None:
    assert re.search(says, refusal(finished, tmp_path, change))


@pytest.mark.parametrize("name", ["twists", "step", "exp_avg", "exp_avg_sq"])
@pytest.mark.parametrize("finished", ["poses"], indirect=True)
def test_learned_poses_of_other_cameras_are_refused(
    finished: tuple[Path, RunSettings], tmp_path: Path, name: str
) -> None:
    def change(_: dict[str, Any], tensors: dict[str, Tensor]) -> None:
        tensors[f"poses.{name}"] = torch.cat([tensors[f"poses.{name}"]] * 2)

    assert f"poses.{name} is (16" in refusal(finished, tmp_path, change)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda s, _: s.update(groups="square"), "the names of its groups are no list"),
        (lambda s, _: s.update(groups=[3]), "the names of its groups are no list"),
        (lambda s, _: s.update(groups=[]), "names a group that is not there"),
        (lambda s, _: s.update(groups=["a", "b"]), r"groups\."),
        (lambda _, t: t["model.anchors.group"].fill_(7), "names a group that is not there"),
        (lambda _, t: t.update({"model.groups.position": torch.zeros(1, 2, 3)}), "groups.position has shape"),
        (lambda _, t: t.update({"model.groups.position": torch.zeros(3)}), "groups.position has shape"),
    ],
)
@pytest.mark.parametrize("finished", ["riding"], indirect=True)
def test_groups_that_do_not_fit_are_refused(
    finished: tuple[Path, RunSettings], tmp_path: Path, change: Change, says: str
) -> None:
    assert re.search(says, refusal(finished, tmp_path, change))
