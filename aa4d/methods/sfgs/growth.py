"""Growing of anchors in space and time: Scaffold-GS's rule, in voxels that last a moment, on weighted statistics."""

from __future__ import annotations

import torch

from aa4d.anchors.densification import Statistics
from aa4d.methods.anchor_growth import edit_with_scales, judge
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
    anchors, rows = model.anchors, model.anchors.rows()
    cell_s = settings.cell_frames * float(model.frame_s)
    keep, growth = judge(
        settings, statistics, rows.position, rows.moments(), voxel=voxel, generator=generator, time_cell=cell_s
    )
    log_scale = growth.voxel.log()[:, None].repeat(1, 7)
    log_scale[:, 3] = torch.tensor(cell_s).log()
    return edit_with_scales(anchors, keep, growth, log_scale, gaussians_from=4)
