"""Anchors of the toy run that ride on rigid groups, whose trajectories are those of the toy's square or the like."""

import torch

from aa4d.methods.model_file import LoadedModel
from aa4d.motion.groups import Groups
from aa4d.motion.tracks import ALWAYS
from tests.toy_capture import square_centre

CONTROLS = 7


def ride(
    loaded: LoadedModel,
    group: torch.Tensor,
    *,
    pace: float = 1.0,
    turn: float = 0.0,
    shown: tuple[tuple[float, float, float, float], ...] = (ALWAYS,),
) -> None:
    """Let the anchors ride, those of `group` [N] -1 not at all; where they are at t = 0 does not change.

    Every group starts where the square does, goes along its way at `pace` times its speed, and turns by `turn`
    radians over the clip. The field stops moving anchors and their Gaussians, so that the groups alone do.
    """
    model, n = loaded.model, len(shown)
    for part in (model.head_position.output, model.dlgd_offset, model.dlgd_scale):
        for parameter in part.parameters():
            torch.nn.init.zeros_(parameter)
    # A spline of evenly spaced control points is a straight line: control k stands for t = (k - 1) / (C - 3).
    t = (torch.arange(CONTROLS) - 1) / (CONTROLS - 3)
    start, end = (torch.tensor([*square_centre(x), 0.0]) for x in (0.0, 1.0))
    way = (start + pace * t[:, None] * (end - start) - torch.tensor(loaded.frame.origin_m)) / loaded.frame.unit_m
    control = torch.cat([way, turn * t[:, None]], dim=1).float()
    at_zero = torch.cat([(start - torch.tensor(loaded.frame.origin_m)) / loaded.frame.unit_m, torch.zeros(1)]).float()
    names = tuple(f"car {g}" for g in range(n))
    up = torch.tensor([0.0, 0.0, 1.0])
    groups = Groups(names, control.repeat(n, 1, 1), at_zero.repeat(n, 1), torch.tensor(shown), up)
    with torch.no_grad():
        model.anchors.position[group >= 0] -= at_zero[:3]
    model.ride(groups, group)
