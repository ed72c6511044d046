"""The one entry to every rasteriser back end."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Literal

from torch import Tensor

from aa4d.raster.types import Camera, Gaussians, Rendering

Backend = Literal["auto", "native", "reference"]

# name: module that has rasterize(gaussians, camera, background, depth) -> Rendering. Imported on first use.
_BACKENDS = {"native": "aa4d.raster.native", "reference": "aa4d.raster.reference"}


def rasterize(
    gaussians: Gaussians,
    camera: Camera,
    *,
    background: Tensor,  # [3]
    depth: bool = False,
    backend: Backend = "auto",
) -> Rendering:
    """Draw Gaussians over a background; differentiable with respect to every tensor of both.

    Args:
        gaussians: N Gaussians, N may be zero.
        camera: a pinhole camera.
        background: [3] colour behind everything, sRGB in [0, 1].
        depth: whether `Rendering.depth` is wanted.
        backend: "native" (C++ on the CPU), "reference" (plain torch, any dtype, slow), or "auto": native.

    Raises:
        ValueError: a tensor has the wrong shape, or the back end is unknown.
    """
    name = "native" if backend == "auto" else backend
    if name not in _BACKENDS:
        raise ValueError(f"unknown rasteriser back end {backend!r}: use auto, {', '.join(_BACKENDS)}")
    _check_shapes(gaussians, camera, background)
    run: Callable[[Gaussians, Camera, Tensor, bool], Rendering] = import_module(_BACKENDS[name]).rasterize
    return run(gaussians, camera, background, depth)


def _check_shapes(gaussians: Gaussians, camera: Camera, background: Tensor) -> None:
    count = gaussians.means.shape[0] if gaussians.means.dim() else 0
    expected = {
        "means": (gaussians.means, (count, 3)),
        "quaternions": (gaussians.quaternions, (count, 4)),
        "scales": (gaussians.scales, (count, 3)),
        "opacities": (gaussians.opacities, (count,)),
        "colors": (gaussians.colors, (count, 3)),
        "viewmat": (camera.viewmat, (4, 4)),
        "K": (camera.K, (3, 3)),
        "background": (background, (3,)),
    }
    for name, (tensor, shape) in expected.items():
        if tuple(tensor.shape) != shape:
            raise ValueError(f"{name} has shape {tuple(tensor.shape)}, expected {shape}")
    if camera.width < 1 or camera.height < 1:
        raise ValueError(f"the image has {camera.width} x {camera.height} pixels, expected at least 1 x 1")
