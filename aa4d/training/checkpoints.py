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
from aa4d.model import AdaAnchor4D, ModelConfig, blank_model
from aa4d.motion.groups import blank_groups
from aa4d.training.config import LearningRates
from aa4d.training.optimiser import make_optimiser
from aa4d.training.poses import PoseRefinement


@dataclass
class TrainingState:
    """A point between two iterations. Randomness is drawn from (seed, stage, iteration), so none is kept here."""

    stage: str  # "coarse" or "fine"
    iteration: int  # iterations done in this stage
    seconds: float  # of training so far, both stages
    model: AdaAnchor4D
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
    path: Path, config: ModelConfig, rates: LearningRates, device: torch.device, poses: PoseRefinement | None = None
) -> TrainingState:
    """Raises InputError for a damaged file or one of another configuration. `poses` are set to those of the file."""
    try:
        with safe_open(str(path), framework="pt", device=str(device)) as file:
            position = json.loads(file.metadata()["state"])
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118, not a dict
        anchors = len(tensors["model.anchors.position"])
        groups = None
        if "groups" in position:
            groups = blank_groups(tuple(position["groups"]), tensors["model.groups.position"].shape[1])
        model = blank_model(config, anchors, groups).to(device)
        model.load_state_dict(_part(tensors, "model."))
        statistics = Statistics(**_part(tensors, "statistics."))
        optimiser = make_optimiser(model, rates, position["stage"])
        moments = {key: _part(tensors, f"adam.{key}.") for key in ("step", "exp_avg", "exp_avg_sq")}
        for name, parameter in model.named_parameters():
            if name in moments["step"]:
                optimiser.state[parameter] = {key: values[name] for key, values in moments.items()}
        if poses is not None:
            poses.load(_part(tensors, "poses."))
        return TrainingState(
            position["stage"], position["iteration"], position["seconds"], model, optimiser, statistics, poses
        )
    except (SafetensorError, OSError, KeyError, TypeError, ValueError, RuntimeError) as error:
        reason = f"it lacks {error}" if isinstance(error, KeyError) else str(error).splitlines()[0]
        raise InputError(f"{path}: cannot continue from this checkpoint ({reason}); delete it to start over") from None


def _part(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}
