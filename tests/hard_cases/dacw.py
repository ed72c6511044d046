"""DACW: extreme histograms give monotone maps of [-1, 1] onto itself."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from aa4d.methods.adaanchor4d.warping import CoordinateWarp, density_adaptive_boundaries
from aa4d.stress.cases import Part
from tests.hard_cases.errors import refusal

PART = Part("dacw")

ANCHORS = {
    "all mass in one bin": torch.full((10_000, 3), 0.3),
    "two far bins": torch.cat([torch.full((9, 3), -0.9), torch.full((1, 3), 0.9)]),
    "one anchor": torch.zeros(1, 3),
    "no anchors": torch.zeros(0, 3),
    "at both ends": torch.cat([torch.full((5, 3), -1.0), torch.full((5, 3), 1.0)]),
    "on every border of a bin": (torch.arange(65) / 32 - 1)[:, None].repeat(1, 3),
    "denormal": torch.full((7, 3), 1e-42),
    "300,000 to one": torch.cat([torch.full((300_000, 3), 0.99), torch.full((1, 3), -0.99)]),
}


def broken(boundaries: Tensor, high: float) -> float:
    """0 for a monotone map onto the interval; else how far from it, or infinity."""
    if not boundaries.isfinite().all():
        return math.inf
    ends = max(float((boundaries[:, 0] + 1).abs().max()), float((boundaries[:, -1] - 1).abs().max()))
    least = float(boundaries.diff().min())
    return math.inf if least < 0 or (high < 1 and least <= 0) else ends


@PART.case(
    why="empty bins get no room, full ones all of it; p^gamma overflows",
    done="shares of the largest, a floor from lambda below one, float64, and ends set by hand",
    each=ANCHORS,
)
def histograms(u: Tensor) -> float:
    worst = 0.0
    for gamma in (0.0, 1.0, 50.0, 1e4):
        for low, high in ((0.0, 0.0), (0.2, 0.8), (1.0, 1.0), (0.0, 1.0)):
            for smoothing in (0.0, 1e-30, 1.5, 200.0):
                worst = max(worst, broken(density_adaptive_boundaries(u, 64, smoothing, gamma, low, high), high))
    return worst


@PART.case(
    why="one bin, or more bins than float32 has steps between their borders",
    done="bins of equal room where nothing is known; never decreasing",
    each={str(bins): bins for bins in (1, 2, 4096)},
)
def numbers_of_bins(bins: int) -> float:
    u = torch.randn(500, 3, generator=torch.Generator().manual_seed(0)) * 0.3
    return broken(density_adaptive_boundaries(u, bins, 1.5, 1.0, 0.2, 0.8), 0.8)


@PART.case(
    why="coordinates outside of the box, infinite or at its very end",
    done="constant outside, continuous at the border",
    bound=1e-6,
)
def outside_the_interval() -> float:
    warp = CoordinateWarp(64)
    u = torch.randn(100, 3, generator=torch.Generator().manual_seed(1)).clamp(-1, 1)
    warp.boundaries.copy_(density_adaptive_boundaries(u, 64, 1.5, 1.0, 0.2, 0.8))
    ends = torch.tensor([[-math.inf], [-5.0], [-1.0], [1.0], [1.0 + 1e-6], [math.inf]]).repeat(1, 3)
    expected = torch.tensor([[-1.0], [-1.0], [-1.0], [1.0], [1.0], [1.0]]).repeat(1, 3)
    return float((warp(ends) - expected).abs().max())


@PART.case(why="a uniform histogram must change nothing", done="smoothing mirrors at the borders", bound=1e-6)
def uniform_mass_is_the_identity() -> float:
    centres = (torch.arange(64) + 0.5) / 32 - 1
    warp = CoordinateWarp(64)
    warp.boundaries.copy_(density_adaptive_boundaries(centres[:, None].repeat(1, 3), 64, 1.5, 1.0, 0.2, 0.8))
    u = torch.rand(100, 3, generator=torch.Generator().manual_seed(2)) * 2 - 1
    return float((warp(u) - u).abs().max())


@PART.case(why="strengths above one or in the wrong order fold the map", done="refused in one sentence")
def lambda_out_of_range() -> float:
    u = torch.zeros(3, 3)
    return refusal(ValueError, lambda: density_adaptive_boundaries(u, 64, 1.5, 1.0, 0.8, 0.2), "lambda_min")
