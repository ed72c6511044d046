"""The native back end against the float64 reference."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import pytest
import torch
from raster_scenes import (
    BACKGROUND,
    assert_matches_reference,
    camera,
    leaves,
    one_gaussian,
    random_gaussians,
    straight_camera,
)
from raster_scenes import draw as draw_leaves

from aa4d import _native
from aa4d.raster import Gaussians, Options, constants, rasterize
from aa4d.raster.cutoffs import CUTOFFS
from aa4d.raster.native import draw
from aa4d.raster.reference import blend, project


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("mode", ["classic", "antialiased"])
def test_matches_reference(seed: int, mode: str) -> None:
    assert_matches_reference(random_gaussians(200, seed), camera(), mode=mode)


@pytest.mark.parametrize("features", [None, 0, 1, 5, 32])
def test_extra_outputs_match_reference(features: int | None) -> None:
    gaussians = random_gaussians(100, 7, features=features)
    assert_matches_reference(gaussians, camera(), outputs=("depth", "absolute_gradient", "sensitivity"))


def test_exact_precision_matches_reference() -> None:
    assert_matches_reference(random_gaussians(100, 3), camera(), outputs=("depth",), precision="exact")


@pytest.mark.parametrize("size", [(1, 1), (2, 50), (16, 16), (17, 33)])
def test_any_size_of_image(size: tuple[int, int]) -> None:
    assert_matches_reference(random_gaussians(60, 1, size=0.4), camera(*size, focal=20.0), outputs=("depth",))


def test_extra_outputs_change_nothing_else() -> None:
    gaussians = random_gaussians(300, 2)
    plain, plain_gradients = draw_leaves(gaussians, camera(), "native", torch.ones(45, 70, 4))
    weights = torch.ones(45, 70, 7)
    weights[..., 4:] = 0
    featured = replace(gaussians, features=random_gaussians(300, 2, features=2).features)
    full, gradients = draw_leaves(
        featured, camera(), "native", weights, outputs=("depth", "absolute_gradient", "sensitivity")
    )
    assert torch.equal(full.color, plain.color)
    assert torch.equal(full.screen_gradient, plain.screen_gradient)
    assert torch.equal(gradients["scales"], plain_gradients["scales"])
    assert plain.depth is None
    assert plain.features is None
    assert plain.screen_gradient_absolute is None
    assert plain.sensitivity is None


def test_same_bits_for_any_number_of_threads() -> None:
    gaussians, cam = random_gaussians(20000, size=0.05, features=3), camera(200, 120, 180)
    threads = torch.get_num_threads()
    results = []
    try:
        for count in (1, 2, 3, 7):
            torch.set_num_threads(count)
            image, gradients = draw_leaves(
                gaussians, cam, "native", outputs=("depth", "absolute_gradient", "sensitivity")
            )
            results.append([*vars(image).values(), *gradients.values()])
    finally:
        torch.set_num_threads(threads)
    for other in results[1:]:
        assert all(torch.equal(a, b) for a, b in zip(results[0], other, strict=True))


def test_gradient_only_of_what_is_used() -> None:
    inputs = leaves(random_gaussians(50, features=4), torch.float32)
    image = rasterize(inputs, camera(), background=torch.zeros(3), outputs=("depth",))
    image.alpha.sum().backward()
    assert inputs.opacities.grad.count_nonzero() > 0
    assert inputs.colors.grad.count_nonzero() == 0
    assert inputs.features.grad is None


def test_backward_twice_gives_the_same_gradient() -> None:
    inputs = leaves(random_gaussians(50), torch.float32)
    image = rasterize(inputs, camera(), background=torch.zeros(3))
    image.color.sum().backward(retain_graph=True)
    first = inputs.means.grad.clone()
    image.color.sum().backward()
    assert torch.equal(inputs.means.grad, 2 * first)


def test_two_renderings_do_not_share_a_frame() -> None:
    inputs = [leaves(random_gaussians(50, seed), torch.float32) for seed in (0, 1)]
    images = [rasterize(each, camera(), background=torch.zeros(3)) for each in inputs]
    for image in images:
        image.color.sum().backward()
    for each, seed in zip(inputs, (0, 1), strict=True):
        alone = leaves(random_gaussians(50, seed), torch.float32)
        rasterize(alone, camera(), background=torch.zeros(3)).color.sum().backward()
        assert torch.equal(each.means.grad, alone.means.grad)


def test_tensors_of_any_layout_are_taken() -> None:
    gaussians = random_gaussians(50)
    spread = Gaussians(*(None if t is None else torch.stack([t, t], dim=-1)[..., 0] for t in vars(gaussians).values()))
    background = BACKGROUND.float()
    image = rasterize(gaussians, camera(), background=background)
    assert torch.equal(rasterize(spread, camera(), background=background).color, image.color)


def test_constants_are_those_of_the_kernels() -> None:
    assert _native.raster.constants() == {name: value for name, value in vars(constants).items() if name.isupper()}


def test_changing_an_input_before_backward_is_refused() -> None:
    inputs = leaves(random_gaussians(10), torch.float32)
    image = rasterize(inputs, camera(), background=torch.zeros(3))
    with torch.no_grad():
        inputs.means.add_(1)
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        image.color.sum().backward()


@pytest.mark.parametrize("set_name", ["avx512", "avx2", "portable"])
def test_every_instruction_set_agrees(set_name: str, subprocess_python: Any) -> None:
    """The environment chooses when the module is loaded, so each set gets a process of its own."""
    code = (
        "from raster_scenes import *\n"
        "from aa4d import _native\n"
        f"assert _native.raster.instruction_set() == {set_name!r}\n"
        "gaussians = random_gaussians(150, 4, features=3)\n"
        "assert_matches_reference(gaussians, camera(), outputs=('depth', 'absolute_gradient', 'sensitivity'))\n"
        "layers = one_gaussian(means=[[0, 0, 3 + 1e-3 * i] for i in range(1500)], opacities=[0.05])\n"
        "assert_matches_reference(layers, straight_camera(), 1e-5, 3e-5, outputs=('depth',))\n"
    )
    result = subprocess_python(code, AA4D_SIMD=set_name)
    if f"AA4D_SIMD={set_name}: this machine has no such kernels" in result.stderr:
        pytest.skip(f"this machine has no {set_name}")
    assert result.returncode == 0, result.stderr


def test_a_forked_process_draws_too(subprocess_python: Any) -> None:
    """The threads of the pool do not live on in a forked child, which must not wait for them.

    Forward only: torch's own threads do not survive a fork either.
    """
    code = (
        "from raster_scenes import *\n"
        "import multiprocessing, sys\n"
        "torch.set_num_threads(2)\n"
        "gaussians, cam, background = random_gaussians(3000), camera(), torch.zeros(3)\n"
        "def run():\n"
        "    rasterize(gaussians, cam, background=background)\n"
        "run()\n"
        "child = multiprocessing.get_context('fork').Process(target=run)\n"
        "child.start()\n"
        "child.join(30)\n"
        "code = child.exitcode\n"
        "child.kill()\n"
        "sys.exit('the child hangs' if code is None else code)\n"
    )
    result = subprocess_python(code)
    assert result.returncode == 0, result.stderr


def test_no_contribution_of_any_ellipse_is_lost() -> None:
    """Large, small, thin and far outside: as many pixels take part as in float64, but for those on the threshold."""
    generator = torch.Generator().manual_seed(0)
    for i in range(60):
        width, height = torch.randint(1, 150, (2,), generator=generator).tolist()
        scales = 10 ** (4 * torch.rand(1, 3, generator=generator) - 3)
        if i % 3 == 0:
            scales[:, 1:] *= 1e-3
        depth = 1 + 9 * torch.rand(1, 1, generator=generator)
        sideways = 2 * (torch.rand(1, 2, generator=generator) - 0.5) * depth
        gaussian = Gaussians(
            torch.cat([sideways, depth], dim=-1),
            torch.randn(1, 4, generator=generator),
            scales * depth,
            0.02 + 0.98 * torch.rand(1, generator=generator),
            torch.ones(1, 3),
        )
        cam, cutoffs = straight_camera(width, height, focal=float(max(width, height))), CUTOFFS["fast"]
        frame, _ = draw(gaussian, cam, torch.zeros(3), Options())
        y, x = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
        pixels = torch.stack([x, y], dim=-1).reshape(-1, 2).double()
        exact = Gaussians(*(value.double() for value in list(vars(gaussian).values())[:5]))
        weights, _ = blend(project(exact, cam, False, cutoffs), pixels, cutoffs)
        certain = int((weights > cutoffs.alpha * 1.0002).sum())
        assert certain <= frame.count_pairs() <= int((weights > 0).sum()) + 3 + certain // 100


def test_several_python_threads_draw_at_once() -> None:
    gaussians = random_gaussians(100)

    def picture(_: int) -> list[torch.Tensor | None]:
        inputs = leaves(gaussians, torch.float32)
        rasterize(inputs, camera(), background=torch.zeros(3)).color.square().sum().backward()
        return [inputs.means.grad, inputs.scales.grad]

    expected = picture(0)
    with ThreadPoolExecutor(6) as threads:
        for result in threads.map(picture, range(60)):
            assert all(torch.equal(a, b) for a, b in zip(result, expected, strict=True))  # type: ignore[arg-type]


def test_only_what_asks_for_a_gradient_gets_one() -> None:
    everything = leaves(random_gaussians(40), torch.float32)
    rasterize(everything, camera(), background=torch.zeros(3)).color.square().sum().backward()
    for name in ("means", "quaternions", "scales", "opacities", "colors"):
        inputs = Gaussians(**{n: t if t is None else t.float() for n, t in vars(random_gaussians(40)).items()})
        leaf = getattr(inputs, name).requires_grad_()
        rasterize(inputs, camera(), background=torch.zeros(3)).color.square().sum().backward()
        assert torch.equal(leaf.grad, getattr(everything, name).grad)
        assert sum(t is not None and t.grad is not None for t in vars(inputs).values()) == 1


def test_sensitivity_is_squared_pixel_by_pixel() -> None:
    """Of one Gaussian before a plain background, whose picture is o G (c - background) + background at each pixel."""
    cam, background, color = straight_camera(), torch.tensor([0.25, 0.5, 0.75]), torch.tensor([0.2, 0.4, 0.6])
    inputs = leaves(one_gaussian(opacities=[0.5]), torch.float32)
    image = rasterize(inputs, cam, background=background, outputs=("sensitivity",))
    image.color.sum().backward()
    pixels = int((image.alpha > 0).sum())
    expected = pixels * (0.5 * (color - background).sum()) ** 2
    assert pixels > 20
    torch.testing.assert_close(image.sensitivity, expected[None], rtol=1e-4, atol=0)
