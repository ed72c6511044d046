"""DACW: against a transcription of the paper, and where histograms are extreme."""

import numpy as np
import torch
from scipy.ndimage import gaussian_filter1d

from aa4d.methods.adaanchor4d.warping import CoordinateWarp, density_adaptive_boundaries


def boundaries(
    u: torch.Tensor, *, bins: int = 64, smoothing: float = 1.5, gamma: float = 1.0, low: float = 0.2, high: float = 0.8
) -> torch.Tensor:
    return density_adaptive_boundaries(u, bins, smoothing, gamma, low, high)


def test_agrees_with_the_paper_in_loops() -> None:
    u = torch.randn(500, 3).mul(0.3).clamp(-1, 1)
    bins, gamma, low, high = 16, 0.7, 0.1, 0.9
    ours = boundaries(u, bins=bins, smoothing=0, gamma=gamma, low=low, high=high).numpy()
    for d in range(3):
        counts, _ = np.histogram(u[:, d].numpy(), bins=bins, range=(-1, 1))
        p = counts / counts.sum()
        q = (p / (1 / bins)) ** gamma
        strength = low + (high - low) * q / q.max()
        r = (1 - strength) / bins + strength * p
        r = r / r.sum()
        expected = [-1 + 2 * r[:b].sum() for b in range(bins + 1)]
        np.testing.assert_allclose(ours[d], expected, atol=1e-6)


def test_smoothing_is_gaussian_and_mirrors_at_the_borders() -> None:
    u = torch.randn(300, 3).mul(0.4).clamp(-1, 1)
    counts = np.histogram(u[:, 0].numpy(), bins=64, range=(-1, 1))[0].astype(float)
    smoothed = gaussian_filter1d(counts, 1.5, mode="reflect", radius=5)
    p = smoothed / smoothed.sum()
    ours = boundaries(u, low=1.0, high=1.0)[0].numpy()
    np.testing.assert_allclose(ours[1:], -1 + 2 * np.cumsum(p), atol=1e-6)


def test_dense_intervals_receive_more_room() -> None:
    u = torch.cat([torch.rand(900, 3) * 0.2, torch.rand(100, 3) * 2 - 1])
    warp = CoordinateWarp(64)
    warp.boundaries.copy_(boundaries(u))
    ends = warp(torch.tensor([[0.0] * 3, [0.2] * 3]))
    assert (ends[1] - ends[0] > 0.4).all()
