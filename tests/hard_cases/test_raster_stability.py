"""Inputs on which a rasteriser tends to lose digits, divide by zero or crash: value and gradient against float64.

Each test states the bound it keeps where that is looser than the default of `assert_matches_reference`: 2e-6 for the
maps, 5e-6 (relative, in the norm) for each gradient.
"""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from raster_scenes import assert_matches_reference, camera, draw, one_gaussian, random_gaussians, straight_camera
from torch import Tensor

from aa4d.raster import Camera, Gaussians


def stack(*parts: Gaussians) -> Gaussians:
    return Gaussians(
        *(torch.cat(values) for values in zip(*(list(vars(part).values())[:5] for part in parts), strict=True))
    )


def assert_all_zero(gradients: dict[str, Tensor], *but: str) -> None:
    for name, gradient in gradients.items():
        assert gradient.isfinite().all(), name
        if name not in but:
            assert gradient.count_nonzero() == 0, name


def test_on_the_near_plane() -> None:
    assert_matches_reference(
        one_gaussian(means=[[0.001, 0.002, 0.01]], scales=[[0.003, 0.002, 0.001]]), straight_camera()
    )


@pytest.mark.parametrize("z", [0.00999, 0.0, -1e-30, -4.0])
def test_behind_the_near_plane_is_not_drawn(z: float) -> None:
    image, gradients = draw(one_gaussian(means=[[0.0, 0.0, z]]), straight_camera(), "native")
    assert image.alpha.count_nonzero() == 0
    assert image.radii[0] == 0
    assert_all_zero(gradients, "background")


@pytest.mark.parametrize("x", [30.0, 300.0, 3000.0])
def test_grazing_far_outside_the_frame(x: float) -> None:
    """Beyond the frustum the Jacobian is clamped: the Gaussian still reaches into the image if it is large enough."""
    gaussians = one_gaussian(
        means=[[x, 0.1, 1.0]], scales=[[x / 2, x / 8, 0.1]], quaternions=[[1.0, 0.05, -0.03, 0.02]]
    )
    image, _ = assert_matches_reference(gaussians, straight_camera(), outputs=("depth",))
    assert image.alpha.max() > 0.01


def test_covers_the_whole_image() -> None:
    gaussians = stack(one_gaussian(scales=[[50.0, 40.0, 2.0]]), one_gaussian())
    image, _ = assert_matches_reference(gaussians, straight_camera(100, 75), gradient_tolerance=2e-5)
    assert image.alpha.min() > 0.4


def test_smaller_than_a_thousandth_of_a_pixel() -> None:
    """Drawn at the size of the low-pass filter; the gradient of its scale is as small as its scale, and not lost."""
    gaussians = one_gaussian(scales=[[1e-5, 2e-5, 1e-5]])
    _, gradients = assert_matches_reference(gaussians, straight_camera())
    assert gradients["scales"].abs().max() > 0


@pytest.mark.parametrize("scale", [1e-8, 1e8])
@pytest.mark.parametrize("mode", ["classic", "antialiased"])
def test_extreme_scales(scale: float, mode: str) -> None:
    gaussians = stack(one_gaussian(scales=[[scale, scale * 2, scale]], opacities=[0.9]), one_gaussian())
    assert_matches_reference(gaussians, straight_camera(), mode=mode)


@pytest.mark.parametrize("turn", [[1.0, 0.0, 0.0, 0.0], [0.9, 0.1, 0.3, 0.4], [0.92, 0.0, 0.0, 0.38]])
@pytest.mark.parametrize("length", [1.0, 1000.0])
def test_needle(turn: list[float], length: float) -> None:
    """Axes of ratio 1e6: in terms of the covariance alone its determinant is the difference of equal numbers."""
    needle = one_gaussian(scales=[[length, length * 1e-6, length * 1e-6]], quaternions=[turn], opacities=[0.8])
    assert_matches_reference(needle, straight_camera(), gradient_tolerance=1e-5)


@pytest.mark.parametrize("size", [0.0, 1e-30, 1e-20, 1e-8, 1e8])
def test_quaternion_of_any_length(size: float) -> None:
    """Zero does not turn and has no gradient; a short one has the gradient of its direction over its length."""
    quaternions = (torch.tensor([[0.9, 0.1, -0.3, 0.2]]) * size).tolist()
    assert_matches_reference(one_gaussian(quaternions=quaternions, scales=[[0.5, 0.2, 0.1]]), straight_camera())


@pytest.mark.parametrize("opacity", [0.0, 1e-8])
def test_too_faint_to_draw(opacity: float) -> None:
    image, gradients = draw(one_gaussian(opacities=[opacity]), straight_camera(), "native")
    assert image.radii[0] == 0
    assert_all_zero(gradients, "background")


def test_opacity_of_one() -> None:
    """Its alpha is clamped to 0.99 in the middle, where no gradient passes."""
    image, gradients = assert_matches_reference(
        one_gaussian(opacities=[1.0], scales=[[1.0, 0.8, 1.2]]), straight_camera()
    )
    assert image.alpha.max().item() == pytest.approx(0.99)
    assert gradients["opacities"].count_nonzero() == 1


@pytest.mark.parametrize("opacity", [0.05, 0.6, 1.0])
def test_thousands_of_layers_on_one_pixel(opacity: float) -> None:
    """Transmittance would underflow; the sums over layers are of 5000 terms, hence the looser bounds."""
    count = 5000
    generator = torch.Generator().manual_seed(0)
    gaussians = one_gaussian(
        means=[[0.0, 0.0, 3.0 + 1e-3 * i] for i in range(count)],
        opacities=[opacity] * count,
        colors=torch.rand(count, 3, generator=generator).tolist(),
    )
    assert_matches_reference(gaussians, straight_camera(), 1e-5, 3e-5, outputs=("depth",))


def test_many_finished_pixels() -> None:
    """A crowd in which pixels finish at different depths, so that blocks hold finished and unfinished ones."""
    gaussians = random_gaussians(3000, 1, size=0.2)
    gaussians = replace(gaussians, opacities=gaussians.opacities.clamp(min=0.5))
    image, _ = assert_matches_reference(gaussians, camera(), 1e-5, 3e-5, outputs=("depth",))
    assert image.alpha.min() > 0.99


def test_equal_depths_are_drawn_in_the_order_given() -> None:
    places = [[0.1 * i, 0.0, 4.0] for i in range(5)]
    colors = [[0.2 * i, 1 - 0.2 * i, 0.5] for i in range(5)]
    gaussians = one_gaussian(means=places, colors=colors)
    image, _ = assert_matches_reference(gaussians, straight_camera())
    backwards = Gaussians(*(value.flip(0) for value in list(vars(gaussians).values())[:5]))
    assert not torch.equal(draw(backwards, straight_camera(), "native")[0].color, image.color)


def test_identical_gaussians() -> None:
    _, gradients = assert_matches_reference(
        one_gaussian(opacities=[0.3] * 50), straight_camera(), gradient_tolerance=2e-5, outputs=("depth",)
    )
    assert (gradients["means"][0] - gradients["means"][-1]).abs().max() > 0  # those in front matter more


def test_far_from_the_origin() -> None:
    """World coordinates of 1e5 m. The difference to the camera's own must be taken before digits are lost."""
    offset = torch.tensor([1e5, -1e5, 1e5], dtype=torch.float64)
    near = one_gaussian(means=[[0.125, -0.25, 4.0], [-0.5, 0.25, 5.0]], scales=[[0.5, 0.2, 0.1]])
    gaussians = replace(near, means=near.means + offset)
    cam = straight_camera()
    viewmat = cam.viewmat.clone()
    viewmat[:3, 3] = -offset
    image, _ = assert_matches_reference(gaussians, replace(cam, viewmat=viewmat))
    torch.testing.assert_close(image.color, draw(near, cam, "native")[0].color, rtol=0, atol=1e-6)


@pytest.mark.parametrize("center", [(-60.0, 15.0), (400.0, -300.0)])
def test_principal_point_outside_the_image(center: tuple[float, float]) -> None:
    cam = straight_camera()
    K = cam.K.clone()
    K[0, 2], K[1, 2] = center
    z = 4.0
    x, y = ((20 - center[0]) / 32 * z, (12 - center[1]) / 32 * z)
    gaussians = one_gaussian(means=[[x, y, z]], scales=[[0.5, 0.8, 0.3]])
    image, _ = assert_matches_reference(gaussians, replace(cam, K=K))
    assert image.alpha.max() > 0.1


@pytest.mark.parametrize("size", [(1, 1), (1, 70), (31, 33), (65, 2)])
def test_sizes_that_are_no_multiple_of_a_tile(size: tuple[int, int]) -> None:
    gaussians = random_gaussians(50, 3, size=0.5)
    assert_matches_reference(gaussians, camera(*size, focal=15.0), outputs=("depth",))


def test_no_gaussians() -> None:
    image, gradients = draw(random_gaussians(0, features=2), camera(17, 3), "native", outputs=("depth",))
    assert torch.equal(image.color, torch.tensor([0.25, 0.5, 0.75]).expand(3, 17, 3))
    assert image.alpha.count_nonzero() == image.depth.count_nonzero() == image.features.count_nonzero() == 0
    assert gradients["means"].shape == (0, 3)
    assert_all_zero(gradients, "background")


def test_gradient_that_is_not_finite_stays_where_it_belongs() -> None:
    """An infinite gradient of one pixel spoils the Gaussians that reach it, and no other."""
    gaussians = one_gaussian(means=[[-1.5, 0.0, 4.0], [1.5, 0.0, 4.0]])
    cam = straight_camera()
    weights = torch.ones(cam.height, cam.width, 4)
    weights[15, 8] = float("inf")
    _, gradients = draw(gaussians, cam, "native", weights)
    assert not gradients["means"][0].isfinite().all()
    assert gradients["means"][1].isfinite().all()


def test_camera_with_a_tiny_near_plane() -> None:
    cam: Camera = straight_camera(near=1e-30)
    gaussians = stack(one_gaussian(means=[[0.0, 0.0, 1e-25]], scales=[[1e20, 1e20, 1e20]]), one_gaussian())
    image, gradients = draw(gaussians, cam, "native")
    assert image.color.isfinite().all()
    for name, gradient in gradients.items():
        assert gradient.isfinite().all(), name
