"""The native back end against the float64 reference."""

from __future__ import annotations

import pytest
import torch
from raster_scenes import camera, leaves, random_gaussians
from torch import Tensor

from aa4d.raster import Camera, Gaussians, Rendering, _native, constants, rasterize


def draw(gaussians: Gaussians, cam: Camera, backend: str, dtype: torch.dtype) -> tuple[Rendering, dict[str, Tensor]]:
    """Render, and take the gradient of a random functional of colour, alpha and depth."""
    generator = torch.Generator().manual_seed(5)
    weights = torch.randn(cam.height, cam.width, 5, generator=generator, dtype=torch.float64)
    inputs = leaves(gaussians, dtype)
    background = torch.tensor([0.2, 0.5, 0.8], dtype=dtype, requires_grad=True)
    image = rasterize(inputs, cam, background=background, depth=True, backend=backend)
    values = torch.cat([image.color, image.alpha[..., None], image.depth[..., None]], -1)
    (values.double() * weights).sum().backward()
    gradients = {name: value.grad for name, value in vars(inputs).items()} | {"background": background.grad}
    return image, gradients


def relative_error(value: Tensor, truth: Tensor) -> float:
    return float((value.double() - truth.double()).norm() / truth.double().norm())


@pytest.mark.parametrize("seed", range(3))
def test_native_matches_reference(seed: int) -> None:
    gaussians, cam = random_gaussians(200, seed), camera()
    truth, truth_gradients = draw(gaussians, cam, "reference", torch.float64)
    image, gradients = draw(gaussians, cam, "native", torch.float32)
    for name, tolerance in {"color": 2e-6, "alpha": 2e-6, "depth": 3e-5}.items():
        torch.testing.assert_close(getattr(image, name).double(), getattr(truth, name), rtol=tolerance, atol=tolerance)
    for name, gradient in gradients.items():
        assert relative_error(gradient, truth_gradients[name]) < 2e-6, name
    assert relative_error(image.screen_gradient, truth.screen_gradient) < 2e-6


def test_same_bits_for_any_number_of_threads() -> None:
    gaussians, cam = random_gaussians(2000, size=0.05), camera(200, 120, 180)
    threads = torch.get_num_threads()
    results = []
    try:
        for count in (1, 2, 3, 7):
            torch.set_num_threads(count)
            image, gradients = draw(gaussians, cam, "native", torch.float32)
            results.append([image.color, image.alpha, image.depth, image.screen_gradient, *gradients.values()])
    finally:
        torch.set_num_threads(threads)
    for other in results[1:]:
        assert all(torch.equal(a, b) for a, b in zip(results[0], other, strict=True))


def test_no_gaussians_leave_the_background() -> None:
    cam = camera(17, 3)
    image, gradients = draw(random_gaussians(0), cam, "native", torch.float32)
    assert torch.equal(image.color, torch.tensor([0.2, 0.5, 0.8]).expand(3, 17, 3))
    assert image.alpha.count_nonzero() == 0
    assert gradients["means"].shape == (0, 3)


def test_constants_are_those_of_the_kernels() -> None:
    assert _native.constants() == {name: value for name, value in vars(constants).items() if name.isupper()}


def test_wrong_shape_is_refused() -> None:
    good = random_gaussians(3)
    bad = Gaussians(good.means, good.quaternions[:2], good.scales, good.opacities, good.colors)
    with pytest.raises(ValueError, match=r"quaternions has shape \(2, 4\), expected \(3, 4\)"):
        rasterize(bad, camera(), background=torch.zeros(3))
