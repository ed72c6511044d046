"""The one entry to every rasteriser back end."""

from __future__ import annotations

from collections.abc import Callable, Collection
from importlib import import_module
from typing import Literal

from torch import Tensor

from aa4d.raster.checks import check_camera, check_shapes
from aa4d.raster.types import OUTPUTS, Camera, Gaussians, Options, Output, Rendering

Backend = Literal["auto", "native", "gsplat", "reference"]
Rasterizer = Callable[[Gaussians, Camera, Tensor, Options], Rendering]

# Modules with a function `rasterize`, imported on first use.
_BACKENDS = {
    "native": "aa4d.raster.native",
    "gsplat": "aa4d.raster.gsplat",
    "reference": "aa4d.raster.reference",
}


def rasterize(
    gaussians: Gaussians,
    camera: Camera,
    *,
    background: Tensor,  # [3]
    outputs: Collection[Output] = (),
    mode: Literal["classic", "antialiased"] = "classic",
    precision: Literal["fast", "exact"] = "fast",
    mask_invalid: bool = False,
    backend: Backend = "auto",
) -> Rendering:
    """Draw Gaussians over a background; differentiable with respect to all of them, background and `camera.viewmat`.

    Args:
        gaussians: N Gaussians, N may be zero. `Gaussians.features` are drawn where there are any.
        camera: a pinhole camera.
        background: [3] colour behind everything, sRGB in [0, 1].
        outputs, mode, precision, mask_invalid: see `Options`.
        backend: "native" (C++ on the CPU), "gsplat" (CUDA), "reference" (plain torch, any dtype, slow), or "auto":
            native or gsplat, after the device of `gaussians.means`.

    Raises:
        ValueError: a tensor has the wrong shape or holds a NaN or an infinity, or an option is unknown.
        TypeError: something else stands where a tensor or a whole number of pixels should.
        ModuleNotFoundError: the back end needs a package that is not installed.
    """
    if backend == "auto":
        backend = "gsplat" if getattr(gaussians.means, "is_cuda", False) else "native"
    for name, value, known in (
        ("backend", backend, tuple(_BACKENDS)),
        ("mode", mode, ("classic", "antialiased")),
        ("precision", precision, ("fast", "exact")),
    ):
        if value not in known:
            raise ValueError(f"{name} is {value!r}, expected one of {', '.join(known)}")
    unknown = [name for name in outputs if name not in OUTPUTS]
    if isinstance(outputs, str) or unknown:
        raise ValueError(f"outputs is {outputs!r}, expected a collection of {', '.join(OUTPUTS)}")
    check_shapes(gaussians, camera, background)
    check_camera(camera, background)
    run: Rasterizer = import_module(_BACKENDS[backend]).rasterize
    return run(gaussians, camera, background, Options(frozenset(outputs), mode, precision, mask_invalid))
