"""The reference against closed forms and finite differences: everything else is held to it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import torch
from raster_scenes import camera, draw, maps, one_gaussian, random_gaussians, random_weights, straight_camera

from aa4d.raster import Gaussians, Options, rasterize, reference
from aa4d.raster.constants import DILATION
from aa4d.raster.cutoffs import Cutoffs

BLACK = torch.zeros(3, dtype=torch.float64)


def test_ball_in_front_of_the_lens_is_a_round_gaussian() -> None:
    """On the axis a ball of standard deviation s at depth z is drawn with variance (f s / z)^2 + DILATION."""
    cam = straight_camera(41, 31, 32.0)
    ball = one_gaussian(means=[[0.0, 0.0, 4.0]], scales=[[0.5, 0.5, 0.5]], opacities=[0.5])
    image = rasterize(ball, cam, background=BLACK, outputs=("depth",), backend="reference")
    x, y = torch.arange(41) + 0.5 - 20.5, torch.arange(31) + 0.5 - 15.5
    variance = (32 * 0.5 / 4) ** 2 + DILATION
    expected = 0.5 * torch.exp(-(x[None, :] ** 2 + y[:, None] ** 2).double() / (2 * variance))
    expected = torch.where(expected >= 1 / 255, expected, 0)
    torch.testing.assert_close(image.alpha, expected)
    torch.testing.assert_close(image.color, expected[..., None] * ball.colors[0])
    torch.testing.assert_close(image.depth, torch.where(expected > 0, 4.0, 0.0).double())
    assert image.radii[0] == 13  # 4.04 pixels times sqrt(2 ln(0.5 * 255)), rounded up


def test_nearer_covers_farther_over_the_background() -> None:
    two = one_gaussian(
        means=[[0.0, 0.0, 5.0], [0.0, 0.0, 4.0]],
        scales=[[9.0, 9.0, 0.1], [9.0, 9.0, 0.1]],
        quaternions=[[1.0, 0.0, 0.0, 0.0]],
        opacities=[0.5, 0.25],
        colors=[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
    )
    image = rasterize(
        two, straight_camera(1, 1), background=torch.eye(3).double()[2], outputs=("depth",), backend="reference"
    )
    torch.testing.assert_close(image.color[0, 0], torch.tensor([0.375, 0.25, 0.375]).double(), rtol=0, atol=1e-4)
    assert image.depth[0, 0].item() == pytest.approx((0.25 * 4 + 0.375 * 5) / 0.625, abs=1e-4)


def test_antialiased_mode_keeps_the_light_of_a_small_gaussian() -> None:
    """The dilation spreads a small Gaussian; with the compensation its sum over the image is what it was."""
    small = one_gaussian(means=[[0.0, 0.0, 4.0]], scales=[[0.05, 0.05, 0.05]], opacities=[0.9])
    cam = straight_camera(41, 31, 32.0)
    variance = (32 * 0.05 / 4) ** 2
    sums = {}
    for mode in ("classic", "antialiased"):
        image = reference.rasterize(small, cam, BLACK, Options(mode=mode), Cutoffs(1e-12, 0))
        sums[mode] = image.alpha.sum().item()
    assert sums["antialiased"] == pytest.approx(0.9 * 2 * torch.pi * variance, rel=0.01)
    assert sums["classic"] == pytest.approx(0.9 * 2 * torch.pi * (variance + DILATION), rel=0.01)


@pytest.mark.parametrize(
    "name", ["means", "quaternions", "scales", "opacities", "colors", "features", "background", "viewmat"]
)
@pytest.mark.parametrize("mode", ["classic", "antialiased"])
def test_gradients_match_finite_differences(name: str, mode: str) -> None:
    """Central differences of the float64 reference against the gradients of both back ends, every entry."""
    gaussians, cam = random_gaussians(5, 11, features=2), camera(12, 9, 10.0)
    weights = random_weights(cam, 7)
    options: dict[str, Any] = {"outputs": ("depth",), "mode": mode, "precision": "exact"}
    given = {**vars(gaussians), "background": torch.tensor([0.25, 0.5, 0.75]).double(), "viewmat": cam.viewmat}

    def loss(value: torch.Tensor) -> float:
        changed = given | {name: value}
        scene = Gaussians(*(changed[key] for key in vars(gaussians)))
        view = replace(cam, viewmat=changed["viewmat"])
        image = rasterize(scene, view, background=changed["background"], backend="reference", **options)
        return float((maps(image) * weights).sum())

    step = 1e-5
    differences = torch.zeros_like(given[name])
    for i in range(differences.numel() - (4 if name == "viewmat" else 0)):  # its last row is constant
        change = torch.zeros_like(differences)
        change.view(-1)[i] = step
        differences.view(-1)[i] = (loss(given[name] + change) - loss(given[name] - change)) / (2 * step)
    for backend, tolerance in (("reference", 1e-6), ("native", 1e-5)):
        gradient = draw(gaussians, cam, backend, weights, **options)[1][name].double()
        error = (gradient - differences).norm() / differences.norm()
        assert error < tolerance, f"{backend}: {error:.2g}"


def test_absolute_screen_gradient_is_no_smaller_than_that_of_the_sum() -> None:
    gaussians = random_gaussians(30)
    image, _ = draw(gaussians, camera(), "reference", outputs=("absolute_gradient",))
    seen = image.radii > 0
    assert (image.screen_gradient_absolute[seen] > image.screen_gradient[seen]).all()
    assert image.screen_gradient_absolute[~seen].count_nonzero() == 0
