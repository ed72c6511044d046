"""Six feature planes at several resolutions (paper, section 3: spatiotemporal feature factorization)."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

PLANES = ("xy", "xz", "yz", "xt", "yt", "zt")
AXES = {"x": 0, "y": 1, "z": 2, "t": 3}


class FeaturePlanes(nn.Module):
    """H_p^(l) for every plane p and level l, and the box of the model frame that they cover.

    A plane is stored as [C, R2, R1]: its first letter runs along the last axis. Spatial planes start uniform in
    [0.1, 0.5] and planes that contain t at one, as in 4D-GS: at the start nothing varies over time.
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
                values = torch.ones(channels, rows, resolution)
                level[plane] = nn.Parameter(values if plane[1] == "t" else values.uniform_(0.1, 0.5))
            levels.append(nn.ParameterDict(level))
        self.planes = nn.ModuleList(levels)
        self.register_buffer("box", torch.tensor([[-1.0] * 3, [1.0] * 3]))

    @property
    def levels(self) -> int:
        return len(self.planes)

    def by_level(self) -> list[nn.ParameterDict]:
        return [level for level in self.planes if isinstance(level, nn.ParameterDict)]

    def normalise(self, position: Tensor) -> Tensor:
        """u in [-1, 1] over the box; clamped outside, where the planes hold their border's value anyway."""
        lower, upper = self.box[0], self.box[1]
        # An axis without extent (all anchors on one plane) maps to its middle instead of dividing by zero.
        extent = (upper - lower).clamp_min(torch.finfo(position.dtype).tiny)
        return (2 * (position - lower) / extent - 1).clamp(-1, 1)

    def forward(self, u: Tensor, t: float) -> Tensor:
        """Plane features g_p^(l) at the warped coordinates u [N, 3] and one time t in [0, 1]: [L, N, 6, C]."""
        query = torch.cat([u, u.new_full((u.shape[0], 1), 2 * t - 1)], dim=1)
        levels = []
        for level in self.by_level():
            features = [interpolate(level[p], query[:, [AXES[p[0]], AXES[p[1]]]]) for p in PLANES]
            levels.append(torch.stack(features, dim=1))
        return torch.stack(levels)


def interpolate(plane: Tensor, coordinates: Tensor) -> Tensor:
    """Bilinear interpolation of a plane [C, R2, R1] at coordinates [N, 2] in [-1, 1]: [N, C].

    -1 and 1 are the centres of the first and last texel; outside, the border's value.
    """
    sampled = F.grid_sample(
        plane[None], coordinates[None, None], mode="bilinear", padding_mode="border", align_corners=True
    )
    return sampled[0, :, 0].T


def smoothness(plane: Tensor) -> Tensor:
    """Mean squared second difference along the rows (4D-GS calls it total variation); zero for under three rows."""
    if plane.shape[1] < 3:
        return plane.new_zeros(())
    return (plane[:, 2:] - 2 * plane[:, 1:-1] + plane[:, :-2]).square().mean()


def regularisation(field: FeaturePlanes, spatial: float, temporal: float, constancy: float) -> Tensor:
    """4D-GS's plane regularisers with their weights: smooth spatial planes, smooth time, time planes near one."""
    total = field.box.new_zeros(())
    for level in field.by_level():
        for p in PLANES:
            if p[1] == "t":
                total = total + temporal * smoothness(level[p]) + constancy * (1 - level[p]).abs().mean()
            else:
                total = total + spatial * smoothness(level[p])
    return total
