"""Adam over named parameter groups, and its surgery when anchors are added or removed."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.optim import Adam

from aa4d.model import AdaAnchor4D
from aa4d.training.config import Decay, LearningRates


def make_optimiser(model: AdaAnchor4D, rates: LearningRates, stage: str) -> Adam:
    """One group for each kind of parameter; the static stages leave out all that deforms."""
    anchors = model.anchors
    groups: dict[str, list[nn.Parameter]] = {
        "offset": [anchors.offset],
        "feature": [anchors.feature],
        "log_scale": [anchors.log_scale],
        "decoder_opacity": list(model.decoder.opacity.parameters()),
        "decoder_color": list(model.decoder.color.parameters()),
        "decoder_covariance": list(model.decoder.covariance.parameters()),
    }
    if stage == "fine":
        deforming = [model.aggregation, model.encoder, model.head_feature]
        if model.config.dlgd:
            deforming += [model.dlgd_offset, model.dlgd_scale]
        groups["embedding"] = [getattr(anchors, name) for name in model.config.embeddings()]
        groups["planes"] = list(model.field.parameters())
        groups["position"] = list(model.head_position.parameters())
        groups["deformation"] = [p for module in deforming for p in module.parameters()]
        if model.groups is not None:
            groups["tracks"], groups["heading"] = [model.groups.position], [model.groups.heading]
    # eps as in 3DGS: gradients of a mean over pixels are tiny, and the default 1e-8 would damp them.
    return Adam(
        [
            {"params": params, "name": name, "lr": getattr(rates, name).initial, "rate": getattr(rates, name)}
            for name, params in groups.items()
        ],
        eps=1e-15,
        fused=True,
    )


def set_rates(optimiser: Adam, progress: float, resting: tuple[str, ...] = ()) -> None:
    """For `progress` in [0, 1] of the stage; groups named in `resting` do not learn."""
    for group in optimiser.param_groups:
        rate: Decay = group["rate"]
        group["lr"] = 0.0 if group["name"] in resting else rate.at(progress)


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
