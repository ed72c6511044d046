"""4D-GS's regularisers of feature planes, value and gradient in one sweep."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from aa4d import _native
from aa4d.kernels import plain, runs_native


def plane_penalty(planes: Sequence[Tensor], smoothness: Sequence[float], constancy: Sequence[float]) -> Tensor:
    """Sum over planes [R2, R1, C] of smoothness * mean squared second difference along the rows, and of
    constancy * mean |1 - value|; planes of under three rows have no second difference. A scalar.
    """
    if runs_native(*planes):
        wanted = torch.is_grad_enabled() and any(plane.requires_grad for plane in planes)
        value: Tensor = _PlanePenalty.apply(tuple(smoothness), tuple(constancy), wanted, *planes)
        return value
    return _plane_penalty(planes, smoothness, constancy)


def _plane_penalty(planes: Sequence[Tensor], smoothness: Sequence[float], constancy: Sequence[float]) -> Tensor:
    """The twin of `plane_penalty`."""
    total = planes[0].new_zeros(())
    for plane, smooth, constant in zip(planes, smoothness, constancy, strict=True):
        if len(plane) > 2:
            total = total + smooth * (plane[2:] - 2 * plane[1:-1] + plane[:-2]).square().mean()
        total = total + constant * (1 - plane).abs().mean()
    return total


class _PlanePenalty(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, smoothness: tuple[float, ...], constancy: tuple[float, ...], wanted: bool, *planes: Tensor
    ) -> Tensor:
        gradients = [torch.empty_like(plane) if wanted else None for plane in planes]
        value = _native.field.penalise(
            [plain(plane) for plane in planes], smoothness, constancy, gradients, torch.get_num_threads()
        )
        if wanted:
            ctx.save_for_backward(*gradients)
        return torch.tensor(value)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, d_value: Tensor) -> tuple[Tensor | None, ...]:
        scale = d_value.item()  # one, unless the loss as a whole is scaled
        gradients = [gradient if scale == 1 else gradient * scale for gradient in ctx.saved_tensors]
        return None, None, None, *gradients
