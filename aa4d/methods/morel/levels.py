"""Levels of anchors by the variance of their features, and how soon each level grows (feature-variance-guided
hierarchical densification)."""

from __future__ import annotations

import torch
from torch import Tensor


def levels_of(feature: Tensor, quantiles: tuple[float, float]) -> Tensor:
    """Level of each anchor, [N] int64: 0, 1 or 2 as the variance over the components of its feature [N, F] is below
    both quantiles of all variances, between them, or above both."""
    variance = feature.detach().var(dim=1, unbiased=False)
    thresholds = torch.quantile(variance, variance.new_tensor(quantiles))
    return torch.bucketize(variance, thresholds, right=True)


def growth_weight(level: Tensor, delayed: float, progress: float) -> Tensor:
    """Factor of the mean gradient that growing judges by, [N]: 1 at level 0; lambda_L + (1 - lambda_L) eta above.

    Args:
        delayed: lambda_L.
        progress: eta, the share of the stage that is over.
    """
    return torch.where(level == 0, 1.0, delayed + (1 - delayed) * progress)
