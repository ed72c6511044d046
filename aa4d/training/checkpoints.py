"""Checkpoints: everything that the next iteration depends on, in one safetensors file."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor
from torch.optim import Adam

from aa4d.anchors.densification import Statistics
from aa4d.errors import InputError
from aa4d.files import whole_file
from aa4d.methods import method_of
from aa4d.methods.anchor_model import AnchorModel
from aa4d.methods.scene_model import SceneModel
from aa4d.methods.settings import RunSettings
from aa4d.motion.groups import blank_groups
from aa4d.training.optimiser import make_optimiser
from aa4d.training.poses import PoseRefinement
from aa4d.training.schedule import schedule_of


@dataclass
class TrainingState:
    """A point between two iterations. Randomness is drawn from (seed, stage, iteration), so none is kept here."""

    stage: str  # its name
    iteration: int  # iterations done in this stage
    seconds: float  # of training so far, over all stages
    model: SceneModel
    optimiser: Adam
    statistics: Statistics
    poses: PoseRefinement | None = None  # where poses are learned


def save_checkpoint(path: Path, state: TrainingState) -> None:
    tensors = {f"model.{name}": value for name, value in state.model.state_dict().items()}
    tensors |= {f"statistics.{name}": value for name, value in vars(state.statistics).items()}
    for name, parameter in state.model.named_parameters():
        for key, value in state.optimiser.state.get(parameter, {}).items():
            tensors[f"adam.{key}.{name}"] = value
    if state.poses is not None:
        tensors |= {f"poses.{name}": value for name, value in state.poses.tensors().items()}
    position: dict[str, Any] = {"stage": state.stage, "iteration": state.iteration, "seconds": state.seconds}
    if state.model.groups is not None:
        position["groups"] = state.model.groups.names
    with whole_file(path) as temporary:
        contiguous = {name: value.detach().contiguous() for name, value in tensors.items()}
        save_file(contiguous, str(temporary), metadata={"state": json.dumps(position)})


def load_checkpoint(
    path: Path, settings: RunSettings, device: torch.device, poses: PoseRefinement | None = None
) -> TrainingState:
    """Raises InputError for a damaged file or one of another configuration. `poses` are set to those of the file."""
    try:
        with safe_open(str(path), framework="pt", device=str(device)) as file:
            position = json.loads(file.metadata()["state"])
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118, not a dict
        stage = schedule_of(settings)[position["stage"]]
        model = method_of(settings.method).blank(settings, len(tensors["statistics.seen"]))
        if "groups" in position and isinstance(model, AnchorModel):
            groups = blank_groups(tuple(position["groups"]), tensors["model.groups.position"].shape[1])
            model.ride(groups, torch.zeros(len(model), dtype=torch.long))
        model.to(device).load_state_dict(_part(tensors, "model."))
        statistics = Statistics(**_part(tensors, "statistics."))
        optimiser = make_optimiser(model, settings.rates, canonical=stage.canonical)
        moments = {key: _part(tensors, f"adam.{key}.") for key in ("step", "exp_avg", "exp_avg_sq")}
        for name, parameter in model.named_parameters():
            if name in moments["step"]:
                optimiser.state[parameter] = {key: values[name] for key, values in moments.items()}
        if poses is not None:
            poses.load(_part(tensors, "poses."))
        return TrainingState(
            position["stage"], position["iteration"], position["seconds"], model, optimiser, statistics, poses
        )
    except (SafetensorError, OSError, KeyError, TypeError, ValueError, RuntimeError, StopIteration) as error:
        reason = f"it lacks {error}" if isinstance(error, KeyError) else str(error).splitlines()[0]
        raise InputError(f"{path}: cannot continue from this checkpoint ({reason}); delete it to start over") from None


def _part(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}
