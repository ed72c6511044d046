"""Scenes for the rasteriser's tests."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from aa4d.raster import Camera, Gaussians


def camera(width: int = 70, height: int = 45, focal: float = 60.0, **changes: object) -> Camera:
    """A camera at the origin that looks along z, turned and moved a little so that no entry of its pose is special."""
    angle = torch.tensor(0.1, dtype=torch.float64)
    c, s = torch.cos(angle), torch.sin(angle)
    viewmat = torch.tensor([[c, 0, s, 0.1], [0, 1, 0, -0.05], [-s, 0, c, 0.2], [0, 0, 0, 1]], dtype=torch.float64)
    K = torch.tensor([[focal, 0, width / 2], [0, focal * 1.05, height / 2], [0, 0, 1]], dtype=torch.float64)
    return replace(Camera(viewmat, K, width, height), **changes)


def random_gaussians(count: int, seed: int = 0, size: float = 0.15, dtype: torch.dtype = torch.float64) -> Gaussians:
    """Gaussians in front of `camera()`, some partly outside the image. Exactly representable in float32."""
    generator = torch.Generator().manual_seed(seed)

    def uniform(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=generator)

    depth = 1.5 + 4 * uniform(count, 1)
    sideways = (uniform(count, 2) - 0.5) * torch.tensor([1.6, 1.0]) * depth
    return Gaussians(
        means=torch.cat([sideways, depth], -1).to(dtype),
        quaternions=torch.randn(count, 4, generator=generator).to(dtype),
        scales=(size * torch.exp(0.7 * torch.randn(count, 3, generator=generator))).to(dtype),
        opacities=(0.05 + 0.9 * uniform(count)).to(dtype),
        colors=uniform(count, 3).to(dtype),
    )


def leaves(gaussians: Gaussians, dtype: torch.dtype) -> Gaussians:
    """A copy whose tensors are leaves that require gradients."""
    return Gaussians(**{name: value.detach().to(dtype).requires_grad_() for name, value in vars(gaussians).items()})
