"""Density-Adaptive Coordinate Warping, DACW (paper, section 4.4)."""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn


class CoordinateWarp(nn.Module):
    """Three monotone piecewise-linear maps of [-1, 1] onto itself, built once after the coarse stage."""

    boundaries: Tensor  # [3, B + 1] output boundaries

    def __init__(self, bins: int) -> None:
        super().__init__()
        self.register_buffer("boundaries", torch.linspace(-1, 1, bins + 1).repeat(3, 1))

    def forward(self, u: Tensor) -> Tensor:
        """u [N, 3], linearly normalised -> warped [N, 3]. Outside [-1, 1] the map is constant, hence continuous."""
        bins = self.boundaries.shape[1] - 1
        position = (u.clamp(-1, 1) + 1) * (bins / 2)
        lower = position.floor().clamp(max=bins - 1)
        index = lower.long().T  # [3, N]
        start = self.boundaries.gather(1, index).T
        end = self.boundaries.gather(1, index + 1).T
        return start + (position - lower) * (end - start)


def density_adaptive_boundaries(
    u: Tensor, bins: int, smoothing: float, gamma: float, lambda_min: float, lambda_max: float
) -> Tensor:
    """Output boundaries of the three maps from the anchors' linearly normalised coordinates.

    Args:
        u: [N, 3] in [-1, 1]; coordinates outside are counted in the border bin.
        bins: B.
        smoothing: standard deviation of the Gaussian smoothing of the histogram, in bins; 0 for none.
        gamma: sensitivity to density, at least 0.
        lambda_min, lambda_max: bounds of the adaptation strength, 0 <= lambda_min <= lambda_max <= 1.

    Returns:
        [3, B + 1] float32, from -1 to 1, never decreasing; strictly increasing where lambda < 1 or bins are filled.
    """
    if not 0 <= lambda_min <= lambda_max <= 1:
        raise ValueError(f"expected 0 <= lambda_min <= lambda_max <= 1, got {lambda_min} and {lambda_max}")
    bin_of = ((u.double().clamp(-1, 1) + 1) * (bins / 2)).long().clamp(max=bins - 1)
    # Counted, not one-hot: a row of bins for each anchor would be gigabytes for a million of them.
    ones = u.new_ones(bin_of.T.shape, dtype=torch.float64)
    counts = ones.new_zeros(len(ones), bins).scatter_add_(1, bin_of.T, ones)
    histogram = counts if len(u) else torch.ones_like(counts)
    mass = _smooth(histogram, smoothing)
    mass = mass / mass.sum(1, keepdim=True)
    # q = (p B)^gamma enters only as q / max q, so it is formed from p / max p: no power of a large number overflows.
    response = (mass / mass.amax(1, keepdim=True)) ** gamma
    strength = lambda_min + (lambda_max - lambda_min) * response
    allocation = (1 - strength) / bins + strength * mass
    allocation = allocation / allocation.sum(1, keepdim=True)
    inner = -1 + 2 * allocation.cumsum(1)[:, :-1]
    ones = inner.new_ones(3, 1)
    return torch.cat([-ones, inner, ones], dim=1).float()


def _smooth(histogram: Tensor, sigma: float) -> Tensor:
    """Gaussian smoothing that mirrors at the borders: mass stays inside, and a uniform histogram stays uniform."""
    radius = min(math.ceil(3 * sigma), histogram.shape[1])
    if radius == 0:
        return histogram
    taps = torch.arange(-radius, radius + 1, dtype=histogram.dtype, device=histogram.device)
    kernel = torch.exp(-0.5 * (taps / sigma) ** 2)
    mirrored = torch.cat([histogram[:, :radius].flip(1), histogram, histogram[:, -radius:].flip(1)], dim=1)
    return F.conv1d(mirrored[:, None], (kernel / kernel.sum())[None, None])[:, 0]
