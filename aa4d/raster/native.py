"""The C++ rasteriser behind torch's autograd. Computes in float32 (projection in float64) whatever it is given."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from aa4d.raster import _native
from aa4d.raster.constants import MIN_ALPHA, MIN_TRANSMITTANCE
from aa4d.raster.types import Camera, Gaussians, Rendering


def rasterize(gaussians: Gaussians, camera: Camera, background: Tensor, depth: bool) -> Rendering:
    """See `aa4d.raster.rasterize`."""
    screen_gradient = torch.zeros(gaussians.means.shape[0])
    color, alpha, depth_map, radii = _Rasterize.apply(
        gaussians.means,
        gaussians.quaternions,
        gaussians.scales,
        gaussians.opacities,
        gaussians.colors,
        background,
        camera,
        depth,
        screen_gradient,
    )
    return Rendering(color, alpha, depth_map, radii, screen_gradient)


def _plain(tensor: Tensor) -> Tensor:
    return tensor.detach().to("cpu", torch.float32).contiguous()


class _Rasterize(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        means: Tensor,
        quaternions: Tensor,
        scales: Tensor,
        opacities: Tensor,
        colors: Tensor,
        background: Tensor,
        camera: Camera,
        depth: bool,
        screen_gradient: Tensor,
    ) -> tuple[Tensor, Tensor, Tensor | None, Tensor]:
        inputs = _plain(means), _plain(quaternions), _plain(scales), _plain(opacities), _plain(colors)
        behind = background.detach().to("cpu", torch.float64).contiguous()
        size = (camera.height, camera.width)
        color, alpha = torch.empty(*size, 3), torch.empty(size)
        depth_map = torch.empty(size) if depth else None
        radii = torch.empty(means.shape[0], dtype=torch.int32)
        ctx.frame = _native.forward(
            *inputs,
            viewmat=camera.viewmat.detach().to("cpu", torch.float64).contiguous(),
            K=camera.K.detach().to("cpu", torch.float64).contiguous(),
            near=camera.near,
            background=behind,
            min_alpha=MIN_ALPHA,
            min_transmittance=MIN_TRANSMITTANCE,
            threads=torch.get_num_threads(),
            color=color,
            alpha=alpha,
            depth=depth_map,
            radii=radii,
        )
        ctx.save_for_backward(*inputs, behind, depth_map)
        ctx.screen_gradient = screen_gradient
        ctx.dtypes = [tensor.dtype for tensor in (means, quaternions, scales, opacities, colors, background)]
        ctx.set_materialize_grads(False)
        ctx.mark_non_differentiable(radii)
        return color, alpha, depth_map, radii

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, d_color: Tensor | None, d_alpha: Tensor | None, d_depth: Tensor | None, _: None) -> Any:
        means, quaternions, scales, opacities, colors, background, depth_map = ctx.saved_tensors
        gradients = [torch.empty_like(tensor) for tensor in (means, quaternions, scales, opacities, colors, background)]
        d_means, d_quaternions, d_scales, d_opacities, d_colors, d_background = gradients
        _native.backward(
            frame=ctx.frame,
            means=means,
            quaternions=quaternions,
            scales=scales,
            opacities=opacities,
            colors=colors,
            background=background,
            min_alpha=MIN_ALPHA,
            min_transmittance=MIN_TRANSMITTANCE,
            threads=torch.get_num_threads(),
            color_gradient=None if d_color is None else _plain(d_color),
            alpha_gradient=None if d_alpha is None else _plain(d_alpha),
            depth_gradient=None if d_depth is None else _plain(d_depth),
            depth=depth_map,
            d_means=d_means,
            d_quaternions=d_quaternions,
            d_scales=d_scales,
            d_opacities=d_opacities,
            d_colors=d_colors,
            d_background=d_background,
            screen_gradient=ctx.screen_gradient,
        )
        return *(gradient.to(dtype) for gradient, dtype in zip(gradients, ctx.dtypes, strict=True)), None, None, None
