"""Supervision by true depth, for controlled studies: how much of an error is of geometry."""

from __future__ import annotations

import torch
from torch import Tensor


def depth_loss(drawn: Tensor | None, true: Tensor, ignored: Tensor | None = None) -> Tensor:
    """Mean over pixels of |drawn - true| / true: it has no unit, and far and near count alike.

    Args:
        drawn: [H, W] expected depth_z as `Rendering.depth` has it, zero where nothing is drawn.
        true: [H, W] in the same unit; where it is not finite nothing is asked for.
        ignored: [H, W] pixels of which nothing is asked either.

    Returns:
        A scalar, zero where no pixel counts.
    """
    assert drawn is not None
    counts = torch.isfinite(true) & (true > 0) & (drawn > 0)
    if ignored is not None:
        counts = counts & ~ignored
    reference = torch.where(counts, true, torch.ones_like(true))
    error = torch.where(counts, (drawn - reference).abs() / reference, torch.zeros_like(true))
    return error.sum() / counts.sum().clamp_min(1)
