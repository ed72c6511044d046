"""The K local Gaussians of each anchor from its state and its decoders' outputs (paper, section 3), fused."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from aa4d import _native
from aa4d.kernels import plain, runs_native
from aa4d.raster.types import Gaussians


def local_gaussians(
    position: Tensor, offset: Tensor, scale: Tensor, opacity: Tensor, color: Tensor, covariance: Tensor
) -> Gaussians:
    """N anchors -> N * K Gaussians, those of an anchor together.

    Args:
        position: [N, 3]
        offset: [N, K, 3] in units of the first three scales.
        scale: [N, 6] positive; the last three are the Gaussians' largest scales.
        opacity: [N, K]; tanh, and not drawn where that is not positive.
        color: [N, 3 K]; its sigmoid is the colour.
        covariance: [N, 7 K]; for each Gaussian three shares of scale before the sigmoid, and a quaternion w x y z of
            any length.
    """
    inputs = (position, offset, scale, opacity, color, covariance)
    if runs_native(*inputs):
        return Gaussians(*_LocalGaussians.apply(*inputs))
    return _local_gaussians(*inputs)


def _local_gaussians(
    position: Tensor, offset: Tensor, scale: Tensor, opacity: Tensor, color: Tensor, covariance: Tensor
) -> Gaussians:
    """The twin of `local_gaussians`."""
    shares, quaternions = covariance.reshape(-1, 7).split([3, 4], dim=1)
    largest = scale[:, None, 3:].expand_as(offset).reshape(-1, 3)
    return Gaussians(
        means=(position[:, None] + offset * scale[:, None, :3]).view(-1, 3),
        quaternions=quaternions,
        scales=largest * torch.sigmoid(shares),
        opacities=torch.tanh(opacity).reshape(-1).clamp_min(0),
        colors=torch.sigmoid(color).reshape(-1, 3),
    )


class _LocalGaussians(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *inputs: Tensor) -> tuple[Tensor, ...]:
        anchors = tuple(plain(tensor) for tensor in inputs)
        count = anchors[1].shape[0] * anchors[1].shape[1]
        outputs = (*(torch.empty(count, width) for width in (3, 4, 3)), torch.empty(count), torch.empty(count, 3))
        _native.field.local_gaussians(anchors, torch.get_num_threads(), outputs)
        ctx.save_for_backward(*anchors, outputs[3], outputs[4])
        return outputs

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *d_outputs: Tensor) -> tuple[Tensor, ...]:
        *anchors, opacities, colors = ctx.saved_tensors
        d_anchors = tuple(torch.empty_like(tensor) for tensor in anchors)
        _native.field.local_gaussians_backward(
            tuple(anchors),
            torch.get_num_threads(),
            opacities,
            colors,
            tuple(plain(d) for d in d_outputs),
            d_anchors,
        )
        return d_anchors
