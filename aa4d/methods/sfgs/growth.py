"""Growing of anchors in space and time: Scaffold-GS's rule, in voxels that last a moment, on weighted statistics."""

from __future__ import annotations

import torch

from aa4d.anchors.densification import Statistics, grow, transparent
from aa4d.methods.adaanchor4d.growth import LARGEST_LOG_SCALE
from aa4d.methods.contract import UnitEdit
from aa4d.methods.sfgs.model import Sfgs
from aa4d.methods.sfgs.settings import Growth


@torch.no_grad()
def grow_and_prune(
    model: Sfgs, statistics: Statistics, settings: Growth, voxel: float, generator: torch.Generator
) -> UnitEdit:
    """Transparent anchors go, whenever they are; anchors come where and when Gaussians have large gradients.

    A new anchor has its parent's feature, no offsets, and its voxel's edges and duration as scales. Covariances are
    bounded at this occasion.

    Args:
        voxel: edge of the finest voxel, model frame.
    """
    d, anchors, rows = settings, model.anchors, model.anchors.rows()
    seen, cell_s = d.interval * d.seen_share, d.cell_frames * float(model.frame_s)
    keep = ~transparent(statistics, min_opacity=d.min_opacity, min_seen=seen)
    growth = grow(
        rows.position,
        rows.moments(),
        statistics,
        voxel=voxel,
        voxel_factor=d.voxel_factor,
        levels=d.levels,
        gradient_threshold=d.gradient_threshold,
        min_drawn=0.5 * seen,
        limit=max(d.max_anchors - len(model), 0),
        generator=generator,
        time_cell=cell_s,
    )
    statistics.forget_judged(min_seen=seen, min_drawn=0.5 * seen)
    anchors.log_scale[:, 4:].clamp_(max=LARGEST_LOG_SCALE)
    log_scale = growth.voxel.log()[:, None].repeat(1, 7)
    log_scale[:, 3] = torch.tensor(cell_s).log()
    log_scale[:, 4:].clamp_(max=LARGEST_LOG_SCALE)
    offset = anchors.offset.new_zeros(len(growth.parent), *anchors.offset.shape[1:])
    values = {"anchors.position": growth.position, "anchors.offset": offset, "anchors.log_scale": log_scale}
    return UnitEdit(keep.nonzero()[:, 0], growth.parent, values)
