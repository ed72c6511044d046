"""Six feature planes at several resolutions (paper, section 3: spatiotemporal feature factorization)."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from aa4d.kernels.plane_lookup import PLANES
from aa4d.kernels.plane_penalty import plane_penalty

SPATIOTEMPORAL = [p for p, plane in enumerate(PLANES) if plane[1] == "t"]  # of `PLANES`, those with time


class FeaturePlanes(nn.Module):
    """H_p^(l) for every plane p and level l, and the box of the model frame that they cover.

    A plane is [R2, R1, C]: its first letter runs along R1, and a query reads whole texels (the paper and the model
    file write [C, R2, R1]). Spatial planes start uniform in [0.1, 0.5] and planes that contain t at one, as in 4D-GS:
    at the start nothing varies over time.
    """

    box: Tensor  # [2, 3] lower and upper corner

    def __init__(self, channels: int, spatial: tuple[int, ...], temporal: int) -> None:
        """
        Args:
            channels: C.
            spatial: resolution along x, y and z at each level, coarsest first.
            temporal: resolution along t, the same at every level.
        """
        super().__init__()
        self.channels = channels
        levels = []
        for resolution in spatial:
            level = {}
            for plane in PLANES:
                rows = temporal if plane[1] == "t" else resolution
                values = torch.ones(rows, resolution, channels)
                level[plane] = nn.Parameter(values if plane[1] == "t" else values.uniform_(0.1, 0.5))
            levels.append(nn.ParameterDict(level))
        self.planes = nn.ModuleList(levels)
        self.register_buffer("box", torch.tensor([[-1.0] * 3, [1.0] * 3]))

    @property
    def levels(self) -> int:
        return len(self.planes)

    def by_level(self) -> list[nn.ParameterDict]:
        return [level for level in self.planes if isinstance(level, nn.ParameterDict)]

    def in_order(self) -> list[Tensor]:
        """All planes, level by level, in the order of `PLANES`."""
        return [level[plane] for level in self.by_level() for plane in PLANES]

    def normalise(self, position: Tensor) -> Tensor:
        """u in [-1, 1] over the box; clamped outside, where the planes hold their border's value anyway."""
        lower, upper = self.box[0], self.box[1]
        # An axis without extent (all anchors on one plane) counts as one unit more to both sides: they are its middle.
        flat = (upper == lower).to(position.dtype)
        return (2 * (position - (lower - flat)) / (upper - lower + 2 * flat) - 1).clamp(-1, 1)


def regularisation(field: FeaturePlanes, spatial: float, temporal: float, constancy: float) -> Tensor:
    """4D-GS's plane regularisers with their weights: smooth spatial planes, smooth time, time planes near one."""
    timed = [plane[1] == "t" for plane in PLANES] * field.levels
    return plane_penalty(
        field.in_order(),
        [temporal if has_time else spatial for has_time in timed],
        [constancy if has_time else 0.0 for has_time in timed],
    )
