"""The C++ rasteriser behind torch's autograd. Blends in float32 and projects in float64 whatever dtype it is given."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from aa4d import _native
from aa4d.raster.checks import check_gaussians
from aa4d.raster.cutoffs import CUTOFFS
from aa4d.raster.types import Camera, Gaussians, Options, Rendering


def rasterize(gaussians: Gaussians, camera: Camera, background: Tensor, options: Options) -> Rendering:
    """See `aa4d.raster.rasterize`."""
    count = len(gaussians.means)
    screen = torch.zeros(count)
    screen_absolute = torch.zeros(count) if "absolute_gradient" in options.outputs else None
    sensitivity = torch.zeros(count) if "sensitivity" in options.outputs else None
    color, alpha, depth, features, radii = _Rasterize.apply(
        gaussians.means,
        gaussians.quaternions,
        gaussians.scales,
        gaussians.opacities,
        gaussians.colors,
        gaussians.features,
        background,
        camera.viewmat,
        camera,
        options,
        screen,
        screen_absolute,
        sensitivity,
    )
    return Rendering(color, alpha, depth, radii, screen, screen_absolute, sensitivity, features)


def draw(
    gaussians: Gaussians, camera: Camera, background: Tensor, options: Options
) -> tuple[_native.raster.Frame, Rendering]:
    """Render plain float32 tensors, without gradients, and keep the frame for `_native.raster.backward`."""
    count, size = len(gaussians.means), (camera.height, camera.width)
    features = gaussians.features
    image = Rendering(
        color=torch.empty(*size, 3),
        alpha=torch.empty(size),
        depth=torch.empty(size) if "depth" in options.outputs else None,
        radii=torch.empty(count, dtype=torch.int32),
        screen_gradient=torch.empty(0),
        features=None if features is None else torch.empty(*size, features.shape[1]),
    )
    cutoffs = CUTOFFS[options.precision]
    frame = _native.raster.forward(
        _scene(gaussians, background),
        _native.raster.PinholeCamera(
            _plain(camera.viewmat, torch.float64),
            _plain(camera.K, torch.float64),
            camera.width,
            camera.height,
            camera.near,
        ),
        _native.raster.Settings(
            cutoffs.alpha,
            cutoffs.transmittance,
            options.mode == "antialiased",
            options.mask_invalid,
            torch.get_num_threads(),
        ),
        image.color,
        image.alpha,
        image.depth,
        image.features,
        image.radii,
    )
    if frame is None:
        check_gaussians(gaussians)
        raise AssertionError("the native rasterizer met a number that is not finite, and no tensor has one")
    return frame, image


def _scene(g: Gaussians, background: Tensor) -> _native.raster.Scene:
    return _native.raster.Scene(g.means, g.quaternions, g.scales, g.opacities, g.colors, g.features, background)


def _plain(tensor: Tensor, dtype: torch.dtype = torch.float32) -> Tensor:
    return tensor.detach().to("cpu", dtype).contiguous()


class _Rasterize(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        means: Tensor,
        quaternions: Tensor,
        scales: Tensor,
        opacities: Tensor,
        colors: Tensor,
        features: Tensor | None,
        background: Tensor,
        viewmat: Tensor,
        camera: Camera,
        options: Options,
        screen: Tensor,
        screen_absolute: Tensor | None,
        sensitivity: Tensor | None,
    ) -> tuple[Tensor | None, ...]:
        inputs = (means, quaternions, scales, opacities, colors, features, background, viewmat)
        plain = [None if tensor is None else _plain(tensor) for tensor in inputs]
        frame, image = draw(Gaussians(*plain[:6]), camera, plain[6], options)  # type: ignore[arg-type]
        ctx.frame, ctx.screen, ctx.screen_absolute, ctx.sensitivity = frame, screen, screen_absolute, sensitivity
        ctx.save_for_backward(*plain[:7], image.depth)
        ctx.inputs_like = [None if tensor is None else (tensor.device, tensor.dtype) for tensor in inputs]
        ctx.set_materialize_grads(False)
        ctx.mark_non_differentiable(image.radii)
        return image.color, image.alpha, image.depth, image.features, image.radii

    @staticmethod
    @once_differentiable
    def backward(
        ctx: Any,
        d_color: Tensor | None,
        d_alpha: Tensor | None,
        d_depth: Tensor | None,
        d_features: Tensor | None,
        _d_radii: None,
    ) -> tuple[Tensor | None, ...]:
        means, quaternions, scales, opacities, colors, features, background, depth = ctx.saved_tensors
        gaussians = Gaussians(means, quaternions, scales, opacities, colors, features)
        gradient = Gaussians(
            torch.empty_like(means),
            torch.empty_like(quaternions),
            torch.empty_like(scales),
            torch.empty_like(opacities),
            torch.empty_like(colors),
            None if d_features is None else torch.empty_like(features),
        )
        background_gradient = torch.empty_like(background)
        viewmat_gradient = torch.empty(4, 4) if ctx.needs_input_grad[7] else None
        _native.raster.backward(
            ctx.frame,
            _scene(gaussians, background),
            torch.get_num_threads(),
            color=None if d_color is None else _plain(d_color),
            alpha=None if d_alpha is None else _plain(d_alpha),
            depth=None if d_depth is None else _plain(d_depth),
            depth_value=depth,
            features=None if d_features is None else _plain(d_features),
            d_means=gradient.means,
            d_quaternions=gradient.quaternions,
            d_scales=gradient.scales,
            d_opacities=gradient.opacities,
            d_colors=gradient.colors,
            d_background=background_gradient,
            screen=ctx.screen,
            screen_absolute=ctx.screen_absolute,
            sensitivity=ctx.sensitivity,
            d_features=gradient.features,
            d_viewmat=viewmat_gradient,
        )
        gradients = (*vars(gradient).values(), background_gradient, viewmat_gradient)
        results = [
            None if tensor is None else tensor.to(*like)
            for tensor, like in zip(gradients, ctx.inputs_like, strict=True)
        ]
        return *results, None, None, None, None, None
