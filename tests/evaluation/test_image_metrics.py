"""PSNR and SSIM against scikit-image."""

import math

import numpy as np
import pytest
import torch
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from aa4d.evaluation.image_metrics import StructuralSimilarity, psnr


@pytest.fixture(scope="module")
def images() -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    a = torch.rand(40, 50, 3, generator=generator, dtype=torch.float64)
    return a, (a + 0.1 * torch.randn(a.shape, generator=generator, dtype=torch.float64)).clamp(0, 1)


def test_psnr_agrees_with_scikit_image(images: tuple[torch.Tensor, torch.Tensor]) -> None:
    a, b = images
    assert psnr(a, b) == pytest.approx(peak_signal_noise_ratio(a.numpy(), b.numpy(), data_range=1))


def test_psnr_over_a_mask_counts_its_pixels_alone(images: tuple[torch.Tensor, torch.Tensor]) -> None:
    a, b = images
    mask = torch.zeros(40, 50, dtype=torch.bool)
    mask[3:9, 4:20] = True
    assert psnr(a, b, mask) == pytest.approx(psnr(a[3:9, 4:20], b[3:9, 4:20]))
    assert psnr(a, a) == math.inf
    assert math.isnan(psnr(a, b, torch.zeros_like(mask)))


def test_ssim_agrees_with_scikit_image_where_the_window_fits(images: tuple[torch.Tensor, torch.Tensor]) -> None:
    """scikit-image mirrors at the border and we pad with zeros: the same constant frame makes the two equal."""
    a, b = (torch.zeros(60, 70, 3, dtype=torch.float64) for _ in range(2))
    a[10:50, 10:60], b[10:50, 10:60] = images
    expected = structural_similarity(
        a.numpy(),
        b.numpy(),
        channel_axis=2,
        data_range=1,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        full=True,
    )[1].mean()
    assert StructuralSimilarity(b)(a).item() == pytest.approx(expected, abs=1e-9)


def test_ssim_of_equal_images_is_one_and_its_gradient_is_right(images: tuple[torch.Tensor, torch.Tensor]) -> None:
    a, b = images
    assert StructuralSimilarity(a)(a).item() == pytest.approx(1.0)
    small = b[:12, :12].clone().requires_grad_()
    assert torch.autograd.gradcheck(StructuralSimilarity(a[:12, :12]), (small,))


def test_ssim_of_flat_images_is_finite() -> None:
    black, white = torch.zeros(20, 20, 3), torch.ones(20, 20, 3)
    value = StructuralSimilarity(white)(black)
    assert 0 <= value.item() < 0.01
    assert np.isfinite(value.item())
