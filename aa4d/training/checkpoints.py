"""Checkpoints: everything that the next iteration depends on, in one safetensors file."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
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
from aa4d.methods.contract import Stage
from aa4d.methods.scene_model import SceneModel
from aa4d.methods.settings import RunSettings
from aa4d.methods.tensors import check_like
from aa4d.motion.groups import blank_groups
from aa4d.motion.spline import FEWEST_CONTROLS
from aa4d.training.exposures import Exposures
from aa4d.training.optimiser import MOMENTS, load_moments, make_optimiser
from aa4d.training.per_view import PerView
from aa4d.training.poses import PoseRefinement
from aa4d.training.schedule import Schedule, schedule_of
from aa4d.training.spent import Spent

LONGEST_S = 1e9  # of training, 30 years


@dataclass
class TrainingState:
    """A point between two iterations. Randomness is drawn from (seed, stage, iteration), so none is kept here."""

    stage: str  # its name
    iteration: int  # iterations done in this stage
    spent: Spent  # so far, over all stages
    model: SceneModel
    optimiser: Adam
    statistics: Statistics
    poses: PoseRefinement | None = None  # where they are learned
    exposures: Exposures | None = None  # likewise

    @property
    def per_view(self) -> list[PerView]:
        """What is learned of each view."""
        return [each for each in (self.poses, self.exposures) if each is not None]


def save_checkpoint(path: Path, state: TrainingState, run: str | None = None) -> None:
    """`run` is the digest of the run's identity."""
    tensors = {f"model.{name}": value for name, value in state.model.state_dict().items()}
    tensors |= {f"statistics.{name}": value for name, value in vars(state.statistics).items()}
    for name, parameter in state.model.named_parameters():
        for key, value in state.optimiser.state.get(parameter, {}).items():
            tensors[f"adam.{key}.{name}"] = value
    for learned in state.per_view:
        tensors |= {f"{learned.part}.{name}": value for name, value in learned.tensors().items()}
    position: dict[str, Any] = {"stage": state.stage, "iteration": state.iteration, **asdict(state.spent)}
    if run is not None:
        position["run"] = run
    if state.model.groups is not None:
        position["groups"] = state.model.groups.names
    with whole_file(path) as temporary:
        contiguous = {name: value.detach().contiguous() for name, value in tensors.items()}
        save_file(contiguous, str(temporary), metadata={"state": json.dumps(position)})


def load_checkpoint(
    path: Path,
    settings: RunSettings,
    device: torch.device,
    poses: PoseRefinement | None = None,
    exposures: Exposures | None = None,
    *,
    run: str | None = None,
) -> TrainingState:
    """Raises InputError for a damaged file or one of another run. `poses` and `exposures` are set to those of the file.

    A checkpoint of an older version does not say of which `run` it is, and is taken where all fits.
    """
    try:
        with safe_open(str(path), framework="pt", device=str(device)) as file:
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118, not a dict
            position = json.loads(file.metadata()["state"])
        if run is not None and position.get("run", run) != run:
            raise ValueError("it is of a run with another capture or other settings")
        stage, iteration, spent = _position(position, schedule_of(settings))
        _check_finite(tensors)
        model = method_of(settings.method).blank(settings, len(tensors["statistics.seen"]))
        if "groups" in position:
            _ride(model, position["groups"], tensors)
        model.to(device).load_state_dict(_part(tensors, "model."))
        optimiser = make_optimiser(model, settings.rates, canonical=stage.canonical)
        moments = {key: _part(tensors, f"adam.{key}.") for key in MOMENTS}
        if iteration and not moments["step"]:
            raise ValueError("it lacks the optimizer's moments")
        load_moments(model, optimiser, moments)
        statistics = _statistics(model, _part(tensors, "statistics."))
        state = TrainingState(stage.name, iteration, spent, model, optimiser, statistics, poses, exposures)
        for learned in state.per_view:
            learned.load(_part(tensors, f"{learned.part}."))
        return state
    except (SafetensorError, OSError, KeyError, TypeError, ValueError, RuntimeError) as error:
        # The last line: load_state_dict says there what does not fit.
        reason = f"it lacks {error}" if isinstance(error, KeyError) else f"{error}".splitlines()[-1].strip()
        raise InputError(f"{path}: cannot continue from this checkpoint ({reason}); delete it to start over") from None


def _position(position: Any, schedule: Schedule) -> tuple[Stage, int, Spent]:
    """Stage, iteration and time of a header. Raises ValueError for what no training wrote; KeyError, TypeError."""
    name, iteration, seconds = position["stage"], position["iteration"], position["seconds"]
    processor_seconds = position.get("processor_seconds", seconds)  # older versions took the time of the clock alone
    names = [stage.name for stage in schedule.stages]
    if name not in names:
        raise ValueError(f"its stage is {name!r}, and this run has {', '.join(names)}")
    stage = schedule[name]
    if type(iteration) is not int or not 0 <= iteration <= stage.iterations:
        raise ValueError(f"its iteration is {iteration!r:.40}, and the {name} stage has {stage.iterations}")
    for value in (seconds, processor_seconds):
        if type(value) not in (int, float) or not 0 <= value < LONGEST_S:
            raise ValueError(f"its seconds of training are {value!r:.40}")
    return stage, iteration, Spent(float(seconds), float(processor_seconds))


def _check_finite(tensors: dict[str, Tensor]) -> None:
    """Raises ValueError: only finite values are ever saved."""
    for name, value in tensors.items():
        if not torch.isfinite(value).all():
            raise ValueError(f"{name} holds NaN or infinity")


def _ride(model: SceneModel, names: Any, tensors: dict[str, Tensor]) -> None:
    """Let the anchors of a blank model ride as those of the file. Raises ValueError, KeyError, TypeError."""
    if not isinstance(model, AnchorModel):
        raise ValueError("it holds rigid groups, on which nothing of this method rides")
    if not (isinstance(names, list) and all(isinstance(name, str) for name in names)):
        raise ValueError("the names of its groups are no list of texts")
    position, group = tensors["model.groups.position"], tensors["model.anchors.group"]
    if position.dim() != 3 or position.shape[1] < FEWEST_CONTROLS:
        raise ValueError(f"model.groups.position has shape {tuple(position.shape)}")
    if not ((group >= -1) & (group < len(names))).all():
        raise ValueError(f"model.anchors.group names a group that is not there (it has {len(names)})")
    model.ride(blank_groups(tuple(names), position.shape[1]), torch.zeros(len(model), dtype=torch.long))


def _statistics(model: SceneModel, tensors: dict[str, Tensor]) -> Statistics:
    """Raises ValueError where they are not of that many units, KeyError or TypeError where some lack."""
    for name, blank in vars(Statistics.zeros(len(model), model.per_unit)).items():
        check_like(tensors[name], blank, f"statistics.{name}")
    return Statistics(**tensors)


def _part(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}
