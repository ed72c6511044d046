"""Growing and pruning within training: when, by which settings, and what the new anchors inherit."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from aa4d.anchors.canonical import EMBEDDINGS
from aa4d.anchors.densification import Growth, grow, transparent
from aa4d.rendering import Rendered
from aa4d.training.checkpoints import TrainingState
from aa4d.training.config import Densification
from aa4d.training.optimiser import replace_rows

# No Gaussian is wider than the scene is deep (Scaffold-GS has the number in scenes of any unit; ours have unit depth).
LARGEST_LOG_SCALE = 0.05


def densify(
    state: TrainingState,
    settings: Densification,
    rendered: Rendered,
    voxel: float,
    seed: tuple[int, ...],
    group_voxel: float = 0.0,
) -> None:
    """After the backward pass of the iteration that makes `state.iteration` + 1.

    Args:
        voxel: edge of the finest voxel, model frame; `group_voxel`: likewise, of anchors that belong to a group.
        seed: of the stage; with the iteration it makes the choices at random, so that a checkpoint keeps none.
    """
    d, done = settings, state.iteration + 1
    if not d.statistics_from < done <= d.until:
        return
    anchors = state.model.anchors
    state.statistics.add(rendered.visible, rendered.gaussians, rendered.rendering)
    if done <= d.start or done % d.interval:
        return
    seen = d.interval * d.seen_share
    # On the CPU, so that every device draws alike.
    generator = torch.Generator().manual_seed(int(np.random.SeedSequence([*seed, done]).generate_state(1)[0]))
    keep = ~transparent(state.statistics, min_opacity=d.min_opacity, min_seen=seen)
    growth = grow(
        anchors.position,
        anchors.position[:, None] + anchors.offset * anchors.log_scale[:, None, :3].exp(),
        state.statistics,
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
    state.statistics.forget_judged(min_seen=seen, min_drawn=0.5 * seen)
    change_anchors(state, keep, growth)


def change_anchors(state: TrainingState, keep: Tensor, growth: Growth) -> None:
    """Drop the anchors outside `keep` and add the grown ones; moments and statistics follow.

    A grown anchor has its parent's feature and embeddings, no offsets, and the voxel's edge as its scales.
    Gaussians' scales are bounded at this occasion.
    """
    anchors = state.model.anchors
    kept = keep.nonzero()[:, 0]
    rows = torch.cat([kept, torch.full_like(growth.parent, -1)])
    inherited = torch.cat([kept, growth.parent])
    offset, log_scale = anchors.offset.detach(), anchors.log_scale.detach()
    owned = [name for name in ("feature", *EMBEDDINGS) if getattr(anchors, name) is not None]
    values = {name: getattr(anchors, name).detach()[inherited] for name in owned}
    values["offset"] = torch.cat([offset[kept], torch.zeros_like(offset[growth.parent])])
    values["log_scale"] = torch.cat([log_scale[kept], growth.voxel.log()[:, None].repeat(1, 6)])
    values["log_scale"][:, 3:].clamp_(max=LARGEST_LOG_SCALE)
    for name, value in values.items():
        parameter = nn.Parameter(value)
        replace_rows(state.optimiser, getattr(anchors, name), parameter, rows)
        setattr(anchors, name, parameter)
    anchors.position = torch.cat([anchors.position[kept], growth.position])
    if anchors.group is not None:
        anchors.group = anchors.group[inherited]
    state.statistics = state.statistics.rows(rows)
