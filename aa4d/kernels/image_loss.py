"""The training loss of an image, L1 and D-SSIM, and its gradient, in three sweeps over the image."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from aa4d import _native
from aa4d.evaluation.image_metrics import StructuralSimilarity
from aa4d.kernels import plain, runs_native


def image_loss(image: Tensor, target: Tensor, dssim: float) -> tuple[Tensor, Tensor]:
    """(1 - dssim) * mean |image - target| + dssim * (1 - SSIM), and the mean squared error.

    SSIM has an 11x11 Gaussian window of sigma 1.5, zero padding, and is the mean over pixels and channels.

    Args:
        image, target: [H, W, 3] in [0, 1].

    Returns:
        Two scalars: the loss, differentiable by `image`, and the squared error, without gradient.
    """
    if runs_native(image, target) and not target.requires_grad:
        wanted = torch.is_grad_enabled() and image.requires_grad
        results: tuple[Tensor, Tensor] = _ImageLoss.apply(image, target, dssim, wanted)
        return results
    return _image_loss(image, target, dssim)


def _image_loss(image: Tensor, target: Tensor, dssim: float) -> tuple[Tensor, Tensor]:
    """The twin of `image_loss`."""
    absolute = (image - target).abs().mean()
    loss = (1 - dssim) * absolute + dssim * (1 - StructuralSimilarity(target)(image))
    return loss, (image.detach() - target).square().mean()


class _ImageLoss(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, image: Tensor, target: Tensor, dssim: float, wanted: bool) -> tuple[Tensor, Tensor]:
        gradient = torch.empty(image.shape) if wanted else None
        similarity, absolute, squared = _native.field.compare_images(
            plain(image), plain(target), dssim, gradient, torch.get_num_threads()
        )
        if wanted:
            ctx.save_for_backward(gradient)
        error = torch.tensor(squared)
        ctx.mark_non_differentiable(error)
        return torch.tensor((1 - dssim) * absolute + dssim * (1 - similarity)), error

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, d_loss: Tensor, _d_error: Tensor) -> tuple[Tensor | None, ...]:
        (gradient,) = ctx.saved_tensors
        return d_loss * gradient, None, None, None
