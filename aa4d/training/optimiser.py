"""Adam over named parameter groups, and what becomes of it and of the statistics when units come and go."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn
from torch.optim import Adam

from aa4d.anchors.densification import Statistics
from aa4d.methods.contract import UnitEdit
from aa4d.methods.scene_model import SceneModel
from aa4d.methods.settings import CommonRates, Decay
from aa4d.methods.tensors import check_like

MOMENTS = ("step", "exp_avg", "exp_avg_sq")  # what Adam keeps of a parameter


def make_optimiser(model: SceneModel, rates: CommonRates, *, canonical: bool) -> Adam:
    """One group for each kind of parameter; its rate is the attribute of `rates` with the group's name."""
    # eps as in 3DGS: gradients of a mean over pixels are tiny, and the default 1e-8 would damp them.
    return Adam(
        [
            {"params": params, "name": name, "lr": getattr(rates, name).initial, "rate": getattr(rates, name)}
            for name, params in model.parameter_groups(canonical=canonical).items()
        ],
        eps=1e-15,
        fused=True,
    )


def load_moments(model: SceneModel, optimiser: Adam, moments: Mapping[str, Mapping[str, Tensor]]) -> None:
    """Give an optimiser what it kept: for each of `MOMENTS` a tensor by the name of its parameter.

    The fused step reads and writes as many values as the parameter has, whatever a moment's own shape.

    Raises:
        ValueError: a moment does not fit its parameter, or there is none of its name. KeyError: one lacks.
    """
    ids = {id(parameter) for group in optimiser.param_groups for parameter in group["params"]}
    learned = {name: parameter for name, parameter in model.named_parameters() if id(parameter) in ids}
    for name in {name for of_key in moments.values() for name in of_key}:
        if name not in learned:
            raise ValueError(f"it holds moments of {name}, which does not learn in this stage")
        state = {key: moments[key][name] for key in MOMENTS}
        check_moments(state, learned[name], name)
        optimiser.state[learned[name]] = state


def check_moments(state: Mapping[str, Tensor], parameter: Tensor, name: str) -> None:
    """Raises ValueError where Adam could not have kept `state` of a parameter."""
    check_like(state["step"], parameter.new_zeros(()), f"adam.step.{name}")
    for key in ("exp_avg", "exp_avg_sq"):
        check_like(state[key], parameter, f"adam.{key}.{name}")
    if state["step"] < 0 or (state["exp_avg_sq"] < 0).any():
        raise ValueError(f"the moments of {name} are negative")


def set_rates(optimiser: Adam, progress: float, resting: tuple[str, ...] = ()) -> None:
    """For `progress` in [0, 1] of the stage; groups named in `resting` do not learn."""
    for group in optimiser.param_groups:
        rate: Decay = group["rate"]
        group["lr"] = 0.0 if group["name"] in resting else rate.at(progress)


def edit_units(model: SceneModel, optimiser: Adam, statistics: Statistics, edit: UnitEdit) -> Statistics:
    """Let units go and come in every tensor that has a row for each; moments and statistics of new ones are zero."""
    rows = torch.cat([edit.keep, torch.full_like(edit.parent, -1)])
    inherited = torch.cat([edit.keep, edit.parent])
    for name in model.unit_tensors():
        old = model.tensor(name)
        if name in edit.values or name in edit.anew:
            kept = edit.anew.get(name, old.detach()[edit.keep])
            value = torch.cat([kept, edit.values.get(name, old.detach()[edit.parent])])
        else:
            value = old.detach()[inherited]
        if isinstance(old, nn.Parameter):
            value = nn.Parameter(value)
            replace_rows(optimiser, old, value, torch.full_like(rows, -1) if name in edit.anew else rows)
        model.replace_tensor(name, value)
    return statistics.rows(rows)


def replace_rows(optimiser: Adam, old: nn.Parameter, new: nn.Parameter, rows: Tensor) -> None:
    """Let `new` take the place of `old`; row i inherits the moments of row rows[i], or zero where rows[i] is -1."""
    for group in optimiser.param_groups:
        group["params"] = [new if p is old else p for p in group["params"]]
    state = optimiser.state.pop(old, None)
    if state:
        inherited = rows >= 0
        for key in ("exp_avg", "exp_avg_sq"):
            moments = torch.zeros_like(new)
            moments[inherited] = state[key][rows[inherited]]
            state[key] = moments
        optimiser.state[new] = state
