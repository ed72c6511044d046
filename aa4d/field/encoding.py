"""Positional encoding by sines of rising frequency (NeRF, Mildenhall et al. 2020)."""

from __future__ import annotations

import torch
from torch import Tensor


def encoded(x: Tensor, frequencies: int) -> Tensor:
    """x [N, D] -> x, sin x, cos x, sin 2x, cos 2x, sin 4x, ...: [N, D (1 + 2 frequencies)]."""
    values = [x]
    for k in range(frequencies):
        values += [torch.sin(2**k * x), torch.cos(2**k * x)]
    return torch.cat(values, dim=1)
