"""Growing and pruning of anchors after Scaffold-GS, on statistics gathered over the last iterations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from aa4d.raster.types import Gaussians, Rendering


@dataclass
class Statistics:
    """What growing and pruning go by; all on the anchors' device."""

    opacity: Tensor  # [N] sum of the local Gaussians' opacities
    seen: Tensor  # [N] iterations in which the anchor was in view
    gradient: Tensor  # [N, K] sum of screen-space gradient norms, weighted where a method weighs them
    drawn: Tensor  # [N, K] iterations in which the Gaussian was drawn, weighted likewise

    @staticmethod
    def zeros(anchors: int, offsets: int, device: torch.device | None = None) -> Statistics:
        one, each = torch.zeros(anchors, device=device), torch.zeros(anchors, offsets, device=device)
        return Statistics(one, one.clone(), each, each.clone())

    def add(
        self,
        visible: Tensor,
        gaussians: Gaussians,
        rendering: Rendering,
        views: int = 1,
        weight: Tensor | None = None,
    ) -> None:
        """After the backward pass of an image, in which the anchors `visible` [M] were rendered.

        The gradient is the absolute one where the rasteriser was asked for it.

        Args:
            views: of whose losses the mean was differentiated: the gradient counts as that of the view's own loss.
            weight: [M * K] how much the view says of each Gaussian; None for equally much.
        """
        shape = (len(visible), self.drawn.shape[1])
        absolute = rendering.screen_gradient_absolute
        gradient = rendering.screen_gradient if absolute is None else absolute
        drawn = (rendering.radii > 0).view(shape)
        counts = drawn if weight is None else drawn * weight.view(shape)
        self.seen[visible] += 1
        self.opacity[visible] += gaussians.opacities.detach().view(shape).sum(1)
        self.drawn[visible] += counts
        gradient = views * gradient.view(shape)
        self.gradient[visible] += torch.where(drawn, gradient if weight is None else counts * gradient, 0)

    def forget_judged(self, *, min_seen: float, min_drawn: float) -> None:
        """Begin anew where a statistic has just been judged; rarely seen anchors go on gathering theirs."""
        judged = self.seen > min_seen
        self.seen[judged] = 0
        self.opacity[judged] = 0
        counted = self.drawn > min_drawn
        self.drawn[counted] = 0
        self.gradient[counted] = 0

    def weighted(self, weight: Tensor) -> Statistics:
        """The same with gradients times `weight` [N]."""
        return replace(self, gradient=self.gradient * weight[:, None])

    def rows(self, rows: Tensor) -> Statistics:
        """Those of other anchors: row i from row rows[i], or zero where rows[i] is -1."""
        kept = (rows >= 0).float()
        index = rows.clamp_min(0)
        return Statistics(
            self.opacity[index] * kept,
            self.seen[index] * kept,
            self.gradient[index] * kept[:, None],
            self.drawn[index] * kept[:, None],
        )


@dataclass(frozen=True)
class Growth:
    """New anchors: where, how large, and from whom they inherit feature and embeddings."""

    position: Tensor  # [M, 3], or [M, 4] with a time
    voxel: Tensor  # [M] edge of the voxel that each fills
    parent: Tensor  # [M] index of an existing anchor


def grow(
    position: Tensor,
    centres: Tensor,
    statistics: Statistics,
    *,
    voxel: float,
    voxel_factor: int,
    levels: int,
    gradient_threshold: float,
    min_drawn: float,
    limit: int,
    generator: torch.Generator,
    group: Tensor | None = None,
    group_voxel: float = 0.0,
    time_cell: float | None = None,
) -> Growth:
    """Anchors in empty voxels where local Gaussians have large screen-space gradients, coarse voxels first.

    Level i has voxels of voxel * voxel_factor / 4^i (at least one voxel), twice the threshold of the level before,
    and keeps a candidate with probability 1 - 0.5^(i + 1). A new anchor's parent is the anchor of the candidate with
    the largest gradient in its voxel.

    Args:
        position: [N, 3] canonical anchor centres.
        centres: [N, K, 3] canonical centres of their local Gaussians.
        min_drawn: iterations that a Gaussian must have been drawn in for its statistic to count.
        limit: at most so many new anchors.
        generator: on the CPU, so that every device draws alike.
        group: [N] of each anchor, -1 for the world; None where there is none. Voxels of a group hold its own anchors
            alone, and the finest of them has the edge `group_voxel`.
        time_cell: duration of a voxel at every level, where positions and centres have a time as their fourth
            coordinate; None where they have three.
    """
    gradient = statistics.gradient / statistics.drawn.clamp_min(1)
    counted = statistics.drawn > min_drawn
    if group is not None:
        # In units in which every finest voxel has the same edge.
        unit = torch.where(group >= 0, group_voxel / voxel, 1.0).to(position.dtype)
        position, centres = position / unit[:, None], centres / unit[:, None, None]
    occupied, groups_of_occupied = position, group
    grown: list[Growth] = []
    room = limit
    durations = [] if time_cell is None else [time_cell]
    for level in range(levels):
        edge = voxel * max(voxel_factor / 4**level, 1)
        size = position.new_tensor([edge] * 3 + durations)
        keep = (torch.rand(gradient.shape, generator=generator) < 1 - 0.5 ** (level + 1)).to(position.device)
        candidates = (gradient >= gradient_threshold * 2**level) & counted & keep
        found = _empty_voxels(centres, gradient, candidates, occupied, size, group, groups_of_occupied)
        found = Growth(found.position[:room], found.voxel[:room], found.parent[:room])
        if len(found.parent):
            grown.append(found)
            occupied = torch.cat([occupied, found.position])
            if group is not None and groups_of_occupied is not None:
                groups_of_occupied = torch.cat([groups_of_occupied, group[found.parent]])
            room -= len(found.parent)
    if not grown:
        nobody = torch.zeros(0, dtype=torch.long, device=position.device)
        return Growth(position[:0], position.new_zeros(0), nobody)
    growth = Growth(
        torch.cat([g.position for g in grown]),
        torch.cat([g.voxel for g in grown]),
        torch.cat([g.parent for g in grown]),
    )
    if group is None:
        return growth
    unit = unit[growth.parent]
    return Growth(growth.position * unit[:, None], growth.voxel * unit, growth.parent)


def _empty_voxels(
    centres: Tensor,
    gradient: Tensor,
    candidates: Tensor,
    occupied: Tensor,
    size: Tensor,
    group: Tensor | None,
    groups_of_occupied: Tensor | None,
) -> Growth:
    """Voxels of `size` [D] that hold candidates and no anchor, strongest candidate first."""
    anchor, offset = candidates.nonzero(as_tuple=True)
    order = gradient[anchor, offset].argsort(descending=True, stable=True)
    anchor, cells = anchor[order], torch.round(centres[anchor, offset][order] / size)
    taken_cells, wanted = torch.round(occupied / size), cells
    if group is not None and groups_of_occupied is not None:
        taken_cells = torch.cat([taken_cells, groups_of_occupied[:, None].to(cells.dtype)], 1)
        wanted = torch.cat([wanted, group[anchor][:, None].to(cells.dtype)], 1)
    unique, inverse = torch.unique(torch.cat([taken_cells, wanted]), dim=0, return_inverse=True)
    taken = torch.zeros(len(unique), dtype=torch.bool, device=cells.device)
    taken[inverse[: len(occupied)]] = True
    cell_of = inverse[len(occupied) :]
    first = torch.full((len(unique),), len(cells), dtype=torch.long, device=cells.device)
    first.scatter_reduce_(0, cell_of, torch.arange(len(cells), device=cells.device), "amin")
    chosen = first[~taken].sort().values
    return Growth(cells[chosen] * size, size[:1].expand(len(chosen)), anchor[chosen])


def transparent(statistics: Statistics, *, min_opacity: float, min_seen: float) -> Tensor:
    """Anchors in view more than `min_seen` times whose Gaussians summed to less than `min_opacity` a time, [N] bool."""
    return (statistics.seen > min_seen) & (statistics.opacity < min_opacity * statistics.seen)
