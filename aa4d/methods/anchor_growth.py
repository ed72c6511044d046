"""Growing and pruning of anchors after Scaffold-GS: which go, where new ones come, and what these inherit."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from aa4d.anchors.canonical import Anchors
from aa4d.anchors.densification import Growth, Statistics, grow, transparent
from aa4d.methods.anchor_model import AnchorModel
from aa4d.methods.contract import UnitEdit
from aa4d.methods.settings import AnchorDensification

# No Gaussian is wider than the scene is deep (Scaffold-GS has the number in scenes of any unit; ours have unit depth).
LARGEST_LOG_SCALE = 0.05


def judge(
    settings: AnchorDensification,
    statistics: Statistics,
    position: Tensor,
    centers: Tensor,
    *,
    voxel: float,
    generator: torch.Generator,
    seen: float | None = None,
    weight: Tensor | None = None,
    **cells: Any,
) -> tuple[Tensor, Growth]:
    """Which anchors stay, [N] bool, for the others are transparent; and where local Gaussians have large gradients.

    What was judged is forgotten.

    Args:
        position: [N, D] of anchors; `centers`: [N, K, D] of their Gaussians.
        voxel: edge of the finest voxel, model frame.
        seen: iterations that drew an anchor, before its statistics count; None: the settings' share of the interval.
        weight: [N] of the anchors' gradients.
        cells: what else divides space: `group` and `group_voxel`, or `time_cell`, as `grow` takes them.
    """
    d = settings
    seen = d.interval * d.seen_share if seen is None else seen
    keep = ~transparent(statistics, min_opacity=d.min_opacity, min_seen=seen)
    growth = grow(
        position,
        centers,
        statistics if weight is None else statistics.weighted(weight),
        voxel=voxel,
        voxel_factor=d.voxel_factor,
        levels=d.levels,
        gradient_threshold=d.gradient_threshold,
        min_drawn=0.5 * seen,
        limit=max(d.max_anchors - len(position), 0),
        generator=generator,
        **cells,
    )
    statistics.forget_judged(min_seen=seen, min_drawn=0.5 * seen)
    return keep, growth


def centers_of(anchors: Anchors) -> Tensor:
    """[N, K, 3] of the local Gaussians at rest."""
    return anchors.position[:, None] + anchors.offset * anchors.log_scale[:, None, :3].exp()


def grow_and_prune(
    model: AnchorModel,
    statistics: Statistics,
    settings: AnchorDensification,
    voxel: float,
    group_voxel: float,
    generator: torch.Generator,
) -> UnitEdit:
    """Transparent anchors go, and anchors come where local Gaussians have large gradients.

    Args:
        voxel: edge of the finest voxel, model frame; `group_voxel`: likewise, of anchors that belong to a group.
    """
    anchors = model.anchors
    keep, growth = judge(
        settings,
        statistics,
        anchors.position,
        centers_of(anchors),
        voxel=voxel,
        generator=generator,
        group=anchors.group,
        group_voxel=group_voxel,
    )
    return edit_of(anchors, keep, growth)


@torch.no_grad()
def edit_of(anchors: Anchors, keep: Tensor, growth: Growth) -> UnitEdit:
    """Drop the anchors outside `keep` [N] bool, and add the grown ones.

    A grown anchor has its parent's feature and embeddings, no offsets, and the voxel's edge as its scales.
    Gaussians' scales are bounded at this occasion.
    """
    return edit_with_scales(anchors, keep, growth, growth.voxel.log()[:, None].repeat(1, 6), gaussians_from=3)


@torch.no_grad()
def edit_with_scales(anchors: Any, keep: Tensor, growth: Growth, log_scale: Tensor, gaussians_from: int) -> UnitEdit:
    """Likewise, with log scales [M, S] of the grown ones; from `gaussians_from` on they are the Gaussians'."""
    for scales in (anchors.log_scale, log_scale):
        scales[:, gaussians_from:].clamp_(max=LARGEST_LOG_SCALE)
    offset = anchors.offset.new_zeros(len(growth.parent), *anchors.offset.shape[1:])
    values = {"anchors.position": growth.position, "anchors.offset": offset, "anchors.log_scale": log_scale}
    return UnitEdit(keep.nonzero()[:, 0], growth.parent, values)
