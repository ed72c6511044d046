"""SSIM and its gradient as a training loss, in three sweeps over the image."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from aa4d.evaluation.image_metrics import StructuralSimilarity
from aa4d.kernels import _native, plain, runs_native


def structural_similarity(image: Tensor, target: Tensor) -> Tensor:
    """SSIM of images [H, W, 3] in [0, 1]: 11x11 Gaussian window of sigma 1.5, zero padding, mean over pixels and
    channels. A scalar, differentiable by `image`.
    """
    if runs_native(image, target) and not target.requires_grad:
        wanted = torch.is_grad_enabled() and image.requires_grad
        value: Tensor = _Similarity.apply(image, target, wanted)
        return value
    return _structural_similarity(image, target)


def _structural_similarity(image: Tensor, target: Tensor) -> Tensor:
    """The twin of `structural_similarity`."""
    return StructuralSimilarity(target)(image)


class _Similarity(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, image: Tensor, target: Tensor, wanted: bool) -> Tensor:
        gradient = torch.empty(image.shape) if wanted else None
        value = _native.structural_similarity(plain(image), plain(target), gradient, torch.get_num_threads())
        if wanted:
            ctx.save_for_backward(gradient)
        return torch.tensor(value)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, d_value: Tensor) -> tuple[Tensor | None, ...]:
        (gradient,) = ctx.saved_tensors
        return d_value * gradient, None, None
