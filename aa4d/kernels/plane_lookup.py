"""The six-plane look-up at every level and the sum or product over planes (paper, sections 3 and 4.2), fused."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor
from torch.autograd.function import once_differentiable

from aa4d import _native
from aa4d.kernels import plain, runs_native

# Which coordinates (x, y, z, t) run along a plane's columns and its rows.
PLANES = ("xy", "xz", "yz", "xt", "yt", "zt")
AXES = {"x": 0, "y": 1, "z": 2, "t": 3}


def look_up(planes: Sequence[Tensor], coordinates: Tensor, t: float, scores: Tensor | None) -> Tensor:
    """Plane features at one time, aggregated over the planes; levels are concatenated in their order.

    Args:
        planes: 6 L planes [R2, R1, C], level by level in the order of `PLANES`; the first letter runs along R1.
        coordinates: [N, 3] in [-1, 1]; outside, the border's value.
        t: in [0, 1]; 0 and 1 are the first and the last row of a plane of time.
        scores: [N, 6, C], whose softmax over the planes is the weights of a sum; None for the product of the planes.

    Returns:
        [N, L * C]; differentiable by planes and scores (by the twin also by coordinates).
    """
    if runs_native(*planes, coordinates, scores) and not coordinates.requires_grad:
        features: Tensor = _LookUp.apply(coordinates, t, scores, *planes)
        return features
    return _look_up(planes, coordinates, t, scores)


def _look_up(planes: Sequence[Tensor], coordinates: Tensor, t: float, scores: Tensor | None) -> Tensor:
    """The twin of `look_up`."""
    query = torch.cat([coordinates, coordinates.new_full((len(coordinates), 1), 2 * t - 1)], dim=1)
    features = torch.stack(
        [
            interpolate(plane, query[:, [AXES[letter] for letter in PLANES[i % len(PLANES)]]])
            for i, plane in enumerate(planes)
        ],
        dim=1,
    ).unflatten(1, (-1, len(PLANES)))  # [N, L, 6, C]
    if scores is None:
        return features.prod(dim=2).flatten(1)
    return (torch.softmax(scores, dim=1)[:, None] * features).sum(dim=2).flatten(1)


def interpolate(plane: Tensor, coordinates: Tensor) -> Tensor:
    """Bilinear interpolation of a plane [R2, R1, C] at coordinates [N, 2] in [-1, 1]: [N, C].

    -1 and 1 are the centres of the first and last texel; outside, the border's value.
    """
    # PyTorch counts the numbers of a 16-bit plane with 16 bits, and reads outside a plane of more than 32,767.
    dtype = torch.promote_types(plane.dtype, torch.float32)
    sampled = F.grid_sample(
        plane.permute(2, 0, 1)[None].to(dtype),
        coordinates[None, None].to(dtype),
        mode="bilinear",
        padding_mode="border",
        align_corners=True,
    )
    return sampled[0, :, 0].T.to(plane.dtype)


class _LookUp(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, coordinates: Tensor, t: float, scores: Tensor | None, *planes: Tensor) -> Tensor:
        texels, query = [plain(plane) for plane in planes], plain(coordinates)
        scores = None if scores is None else plain(scores)
        features = torch.empty(len(query), len(planes) // len(PLANES) * planes[0].shape[2])
        weights = None if scores is None else torch.empty_like(scores)
        _native.field.look_up(texels, query, t, scores, torch.get_num_threads(), features, weights)
        ctx.t = t
        ctx.save_for_backward(query, scores, weights, *texels)
        return features

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, d_features: Tensor) -> tuple[Tensor | None, ...]:
        query, scores, weights, *texels = ctx.saved_tensors
        levels = len(texels) // len(PLANES) if weights is None else 1
        result = torch.empty(len(query) * levels * len(PLANES) * texels[0].shape[2])
        d_planes = [torch.empty_like(plane) for plane in texels]
        _native.field.look_up_backward(
            texels, query, ctx.t, scores, weights, plain(d_features), torch.get_num_threads(), result, d_planes
        )
        return None, None, None if weights is None else result.view_as(weights), *d_planes
