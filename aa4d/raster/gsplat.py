"""CUDA through the gsplat package (Ye et al. 2025): the same interface, gsplat's kernels.

What differs from the other back ends is listed in docs/rasteriser.md.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

import torch
from torch import Tensor

from aa4d.raster.checks import check_gaussians, finite
from aa4d.raster.constants import DILATION
from aa4d.raster.types import Camera, Gaussians, Options, Rendering


def rasterize(gaussians: Gaussians, camera: Camera, background: Tensor, options: Options) -> Rendering:
    """See `aa4d.raster.rasterize`. Everything is taken to the device and dtype of `gaussians.means`."""
    rasterization = _load()
    if options.precision != "fast":
        raise ValueError(f"gsplat has no precision {options.precision!r}: use precision='fast' or backend='native'")
    if "sensitivity" in options.outputs:
        raise ValueError("gsplat tells no sensitivity: use backend='native'")
    if options.mask_invalid:
        gaussians = _without_invalid(gaussians)
    else:
        check_gaussians(gaussians)

    means = gaussians.means
    channels, behind = gaussians.colors, background.to(means)
    if gaussians.features is not None:
        channels = torch.cat([channels, gaussians.features], dim=-1)
        behind = torch.cat([behind, behind.new_zeros(gaussians.features.shape[1])])
    maps, alpha, info = rasterization(
        means=means,
        quats=gaussians.quaternions,
        scales=gaussians.scales,
        opacities=gaussians.opacities,
        colors=channels,
        viewmats=camera.viewmat.to(means)[None],
        Ks=camera.K.to(means)[None],
        width=camera.width,
        height=camera.height,
        near_plane=camera.near,
        eps2d=DILATION,
        packed=False,
        backgrounds=behind[None],
        render_mode="RGB+ED" if "depth" in options.outputs else "RGB",
        rasterize_mode=options.mode,
        absgrad="absolute_gradient" in options.outputs,
    )
    screen = means.new_zeros(len(means))
    screen_absolute = means.new_zeros(len(means)) if "absolute_gradient" in options.outputs else None
    centers = info["means2d"]
    if centers.requires_grad:
        centers.register_hook(_screen_gradient_hook(centers, camera, screen, screen_absolute))
    radii = info["radii"][0]
    return Rendering(
        color=maps[0, ..., :3],
        alpha=alpha[0, ..., 0],
        depth=maps[0, ..., -1] if "depth" in options.outputs else None,
        radii=(radii.amax(dim=-1) if radii.dim() == 2 else radii).to(torch.int32),  # gsplat 1.5 has one for each axis
        screen_gradient=screen,
        screen_gradient_absolute=screen_absolute,
        features=None if gaussians.features is None else maps[0, ..., 3 : 3 + gaussians.features.shape[1]],
    )


def _load() -> Callable[..., Any]:
    try:
        return import_module("gsplat").rasterization
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "the rasterizer back end 'gsplat' needs the package gsplat, which is not installed: "
            "pip install gsplat, or use backend='native'"
        ) from error


def _without_invalid(gaussians: Gaussians) -> Gaussians:
    """Gaussians that are not finite become invisible ones; they keep their places, and get no gradient."""
    kept = finite(gaussians)
    tensors: dict[str, Tensor] = {name: tensor for name, tensor in vars(gaussians).items() if tensor is not None}
    masked = {
        name: torch.where(kept if tensor.dim() == 1 else kept[:, None], tensor, 0) for name, tensor in tensors.items()
    }
    return Gaussians(**masked)


def _screen_gradient_hook(
    centers: Tensor, camera: Camera, screen: Tensor, screen_absolute: Tensor | None
) -> Callable[[Tensor], None]:
    """gsplat's gradients are per pixel; it leaves the absolute one as an attribute of the centres."""
    half = centers.new_tensor([camera.width / 2, camera.height / 2])

    def fill(gradient: Tensor) -> None:
        screen.copy_((gradient[0] * half).norm(dim=-1))
        if screen_absolute is not None:
            screen_absolute.copy_((centers.absgrad[0] * half).norm(dim=-1))  # type: ignore[attr-defined]

    return fill
