"""PSNR and SSIM as the literature of Gaussian splatting computes them."""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from torch import Tensor

WINDOW = 11
SIGMA = 1.5
C1 = 0.01**2
C2 = 0.03**2
BEST_DB = 100.0  # what identical images count as in a mean


def psnr(image: Tensor, target: Tensor, mask: Tensor | None = None) -> float:
    """Peak signal-to-noise ratio in dB of images [H, W, 3] in [0, 1], over the pixels of `mask` [H, W] if given.

    Identical images give infinity, an empty mask NaN.
    """
    squared = (image.double() - target.double()).square()
    return decibels(float((squared if mask is None else squared[mask]).mean()))


def decibels(squared_error: float) -> float:
    """PSNR of a mean squared error, for a peak of 1."""
    return math.inf if squared_error == 0 else -10 * math.log10(squared_error)


def capped(value_db: float) -> float:
    """At most `BEST_DB`, so that means of it stay finite; NaN stays."""
    return value_db if math.isnan(value_db) else min(value_db, BEST_DB)


class StructuralSimilarity:
    """SSIM against one fixed target: 11x11 Gaussian window of sigma 1.5, zero padding, mean over pixels and channels.

    The target's own filtered maps are computed once, which saves two fifths of the work of every later call.
    """

    def __init__(self, target: Tensor) -> None:
        """target: [H, W, 3] in [0, 1]"""
        self._target = target.permute(2, 0, 1)
        filtered = _blur(torch.cat([self._target, self._target.square()]))
        self._mean, mean_square = filtered.split(3)
        self._variance = mean_square - self._mean.square()

    def __call__(self, image: Tensor) -> Tensor:
        """image: [H, W, 3] in [0, 1]; differentiable; a scalar."""
        x = image.permute(2, 0, 1)
        mean, mean_square, mean_product = _blur(torch.cat([x, x.square(), x * self._target])).split(3)
        mean_squared = mean.square()
        means = mean * self._mean
        luminance = (2 * means + C1) / (mean_squared + self._mean.square() + C1)
        contrast = (2 * (mean_product - means) + C2) / (mean_square - mean_squared + self._variance + C2)
        return (luminance * contrast).mean()


def _blur(channels: Tensor) -> Tensor:
    """Separable Gaussian window over [C, H, W] with zero padding."""
    taps = torch.arange(WINDOW, dtype=channels.dtype, device=channels.device) - WINDOW // 2
    kernel = torch.exp(-0.5 * (taps / SIGMA).square())
    kernel = kernel / kernel.sum()
    count = len(channels)
    rows = kernel.view(1, 1, 1, -1).expand(count, 1, 1, -1)
    columns = kernel.view(1, 1, -1, 1).expand(count, 1, -1, 1)
    half = WINDOW // 2
    blurred = F.conv2d(channels[None], rows, padding=(0, half), groups=count)
    return F.conv2d(blurred, columns, padding=(half, 0), groups=count)[0]
