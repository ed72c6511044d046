"""The complete rendering pipeline: deform, decode, rasterise."""

from __future__ import annotations

from torch import Tensor

from aa4d.model import AdaAnchor4D
from aa4d.raster import rasterize
from aa4d.raster.types import Camera, Gaussians, Rendering


def render(
    model: AdaAnchor4D, t: float | None, camera: Camera, background: Tensor, *, depth: bool = False
) -> tuple[Rendering, Gaussians]:
    """One image at time t in [0, 1], or of the canonical scene at t = None; `camera` stands in the model frame."""
    gaussians = model.gaussians(t, camera)
    return rasterize(gaussians, camera, background=background, depth=depth), gaussians
