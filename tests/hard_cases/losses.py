"""Losses and metrics: flat, black, white, tiny and broken pictures."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from aa4d.evaluation.image_metrics import StructuralSimilarity, decibels, psnr
from aa4d.kernels.image_loss import _image_loss, image_loss
from aa4d.stress.cases import Part
from tests.hard_cases.errors import against_twin, refusal

PART = Part("losses")


def loss_error(image: Tensor, target: Tensor, dssim: float = 0.2) -> float:
    """Of the loss and its gradient; with respect to the gradient that a picture without structure would have."""
    least = 1 / image.numel()
    return against_twin(
        lambda x: image_loss(x[0], target, dssim)[:1],
        lambda x: _image_loss(x[0], target.double(), dssim)[:1],
        [image.clone().requires_grad_()],
        least,
    )


def noise(*size: int) -> Tensor:
    return torch.rand(*size, 3, generator=torch.Generator().manual_seed(3))


@PART.case(
    why="variances as differences of equal means of squares; windows that are mostly outside",
    done="zero padding as the literature has it; constants hold the denominators up",
    bound=1e-4,
    each={"1 x 1": (1, 1), "1 x 200": (1, 200), "200 x 1": (200, 1), "11 x 11": (11, 11), "30 x 41": (30, 41)},
)
def pictures_of_size(size: tuple[int, int]) -> float:
    target = noise(*size)
    return loss_error((target + 0.1 * (noise(*size) - 0.5)).clamp(0, 1), target)


FLAT = {"black": 0.0, "white": 1.0, "denormal": 1e-40, "grey": 0.5}


@PART.case(
    why="no structure at all, in the picture, the target or both",
    done="constants hold the denominators up",
    bound=1e-4,
    each={f"{a} against {b}": (x, y) for a, x in FLAT.items() for b, y in {**FLAT, "noise": None}.items()},
)
def flat_pictures(values: tuple[float, float | None]) -> float:
    image = torch.full((20, 30, 3), values[0])
    return loss_error(image, noise(20, 30) if values[1] is None else torch.full((20, 30, 3), values[1]))


@PART.case(
    why="SSIM of colors far outside [0, 1]: an exposure that jumped",
    done="computed as it is; gradients stay finite",
    bound=1e-3,
    each={"-2": -2.0, "10": 10.0},
)
def pictures_outside_the_unit_interval(scale: float) -> float:
    return loss_error(noise(20, 30) * scale, noise(20, 30))


@PART.case(why="equal pictures: |0| has no slope, 1 - SSIM cancels", done="zero, and no gradient", bound=1e-4)
def equal_pictures() -> float:
    worst = 0.0
    for image in (noise(20, 30), torch.full((20, 30, 3), 0.5)):
        loss, error = image_loss(image.requires_grad_(), image.detach(), 0.2)
        loss.backward()
        assert error.item() == 0
        assert image.grad is not None
        worst = max(worst, abs(loss.item()), float(image.grad.abs().max()))
    return worst


@PART.case(why="one NaN pixel hides in a comparison", done="the loss is NaN, which the watchdog sees")
def nan_is_shown() -> float:
    image = noise(20, 30)
    image[3, 4, 1] = math.nan
    return 0.0 if all(value.isnan() for value in image_loss(image, noise(20, 30), 0.2)) else math.inf


@PART.case(
    why="a mean over six million values", done="rows in float32, their sums in float64", bound=1e-6, is_slow=True
)
def large_picture() -> float:
    image, target = noise(1080, 1920), noise(1080, 1920).flip(0)
    loss, squared = image_loss(image, target, 0.0)
    truth = (image.double() - target.double()).abs().mean()
    square = (image.double() - target.double()).square().mean()
    return max(abs(float(loss - truth)) / float(truth), abs(float(squared - square)) / float(square))


@PART.case(why="pictures of two sizes, or none", done="refused in one sentence")
def sizes_that_differ() -> float:
    return max(
        refusal(ValueError, lambda: image_loss(noise(5, 5), noise(5, 6), 0.2), "size"),
        refusal(ValueError, lambda: image_loss(noise(0, 5), noise(0, 5), 0.2), "size"),
    )


@PART.case(why="the logarithm of no error, and of no pixels", done="infinity and NaN, as said")
def psnr_of_nothing() -> float:
    image = noise(4, 4)
    empty = psnr(image, image, torch.zeros(4, 4, dtype=torch.bool))
    return 0.0 if psnr(image, image) == math.inf and math.isnan(empty) and decibels(0.0) == math.inf else math.inf


@PART.case(
    why="errors of 1e-300 and 1e300 in decibels", done="a logarithm of a float64", bound=1e-9,
    each={f"{e:g}": e for e in (1e-300, 5e-324, 1e300)},
)  # fmt: skip
def decibels_of(squared: float) -> float:
    return abs(decibels(squared) + 10 * math.log10(squared))


@PART.case(why="SSIM of a picture against itself must be 1", done="same filter for both", bound=1e-6)
def similarity_with_itself() -> float:
    image = noise(30, 40)
    return abs(float(StructuralSimilarity(image)(image)) - 1)
