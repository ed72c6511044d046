"""Adaptive density control of free Gaussians (Kerbl et al. 2023): small ones are cloned, large ones split in two."""

from __future__ import annotations

import torch
from torch import Tensor

from aa4d.anchors.densification import Statistics
from aa4d.methods.contract import UnitEdit
from aa4d.methods.gaussians.model import GaussianModel
from aa4d.methods.gaussians.settings import CloneAndSplit

SPLIT_SHRINK = 1.6


@torch.no_grad()
def clone_and_split(
    model: GaussianModel, statistics: Statistics, settings: CloneAndSplit, generator: torch.Generator
) -> UnitEdit:
    """Of the Gaussians with large mean gradients the small ones get a copy, and the large ones become two.

    The two halves of a split are drawn from the Gaussian itself, with scales 1.6 times smaller. Where `max_gaussians`
    has no room for all, those with the largest gradients come first. All statistics start anew.
    """
    s, rows = settings, model.free.rows()
    n, device = len(rows.position), rows.position.device
    gradient = (statistics.gradient / statistics.drawn.clamp_min(1))[:, 0]
    wanted = gradient >= s.gradient_threshold
    room = max(s.max_gaussians - n, 0)
    if int(wanted.sum()) > room:  # one Gaussian more for each
        chosen = torch.where(wanted, gradient, 0).argsort(descending=True, stable=True)[:room]
        wanted = torch.zeros_like(wanted).index_fill_(0, chosen, True)
    small = rows.log_scale.exp().amax(1) <= s.largest_clone
    cloned, split = (wanted & small).nonzero()[:, 0], (wanted & ~small).nonzero()[:, 0]
    gone = torch.zeros(n, dtype=torch.bool, device=device).index_fill_(0, split, True)
    if n > s.prune_above:
        gone |= rows.opacity.sigmoid() < s.min_opacity
        cloned = cloned[~gone[cloned]]
    halves = split.repeat_interleave(2)
    parent = torch.cat([cloned, halves])
    # On the CPU, so that every device draws alike.
    normal = torch.randn(len(halves), 3, generator=generator).to(device)
    offset = rotated(rows.quaternion[halves], normal * rows.log_scale[halves].exp())
    values = {
        "free.position": torch.cat([rows.position[cloned], rows.position[halves] + offset]),
        "free.log_scale": torch.cat(
            [rows.log_scale[cloned], rows.log_scale[halves] - torch.tensor(SPLIT_SHRINK).log().item()]
        ),
    }
    for value in vars(statistics).values():
        value.zero_()
    return UnitEdit((~gone).nonzero()[:, 0], parent, values)


def rotated(quaternion: Tensor, x: Tensor) -> Tensor:
    """x [N, 3] turned by quaternions w x y z [N, 4] of any non-zero length."""
    q = torch.nn.functional.normalize(quaternion, dim=1)
    w, v = q[:, :1], q[:, 1:]
    twice = 2 * torch.linalg.cross(v, x)
    return x + w * twice + torch.linalg.cross(v, twice)
