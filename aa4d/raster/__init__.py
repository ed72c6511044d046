"""Differentiable rasterisation of 3D Gaussians (Kerbl et al. 2023) on the CPU."""

from aa4d.raster.api import rasterize
from aa4d.raster.types import Camera, Gaussians, Options, Rendering

__all__ = ["Camera", "Gaussians", "Options", "Rendering", "rasterize"]
