"""Growing and pruning of anchors after Scaffold-GS: what a new anchor inherits."""

from __future__ import annotations

import torch
from torch import Tensor

from aa4d.anchors.canonical import Anchors
from aa4d.anchors.densification import Growth, Statistics, grow, transparent
from aa4d.methods.adaanchor4d.settings import Densification
from aa4d.methods.anchor_model import AnchorModel
from aa4d.methods.contract import UnitEdit

# No Gaussian is wider than the scene is deep (Scaffold-GS has the number in scenes of any unit; ours have unit depth).
LARGEST_LOG_SCALE = 0.05


def grow_and_prune(
    model: AnchorModel,
    statistics: Statistics,
    settings: Densification,
    voxel: float,
    group_voxel: float,
    generator: torch.Generator,
) -> UnitEdit:
    """Transparent anchors go, and anchors come where local Gaussians have large gradients.

    Args:
        voxel: edge of the finest voxel, model frame; `group_voxel`: likewise, of anchors that belong to a group.
    """
    d, anchors = settings, model.anchors
    seen = d.interval * d.seen_share
    keep = ~transparent(statistics, min_opacity=d.min_opacity, min_seen=seen)
    growth = grow(
        anchors.position,
        anchors.position[:, None] + anchors.offset * anchors.log_scale[:, None, :3].exp(),
        statistics,
        voxel=voxel,
        voxel_factor=d.voxel_factor,
        levels=d.levels,
        gradient_threshold=d.gradient_threshold,
        min_drawn=0.5 * seen,
        limit=max(d.max_anchors - len(anchors), 0),
        generator=generator,
        group=anchors.group,
        group_voxel=group_voxel,
    )
    statistics.forget_judged(min_seen=seen, min_drawn=0.5 * seen)
    return edit_of(anchors, keep, growth)


@torch.no_grad()
def edit_of(anchors: Anchors, keep: Tensor, growth: Growth) -> UnitEdit:
    """Drop the anchors outside `keep` [N] bool, and add the grown ones.

    A grown anchor has its parent's feature and embeddings, no offsets, and the voxel's edge as its scales.
    Gaussians' scales are bounded at this occasion.
    """
    anchors.log_scale[:, 3:].clamp_(max=LARGEST_LOG_SCALE)
    log_scale = growth.voxel.log()[:, None].repeat(1, 6)
    log_scale[:, 3:].clamp_(max=LARGEST_LOG_SCALE)
    offset = anchors.offset.new_zeros(len(growth.parent), *anchors.offset.shape[1:])
    values = {"anchors.position": growth.position, "anchors.offset": offset, "anchors.log_scale": log_scale}
    return UnitEdit(keep.nonzero()[:, 0], growth.parent, values)
