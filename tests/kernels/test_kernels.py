"""Every fused kernel against its float64 twin, gradients included; edge cases; the same bits from any threads."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
import torch
from torch import Tensor

from aa4d import _native
from aa4d.kernels.image_loss import _image_loss, image_loss
from aa4d.kernels.local_gaussians import _local_gaussians, local_gaussians
from aa4d.kernels.plane_lookup import _look_up, look_up
from aa4d.kernels.plane_penalty import _plane_penalty, plane_penalty
from aa4d.kernels.two_layer import _two_layer, two_layer
from aa4d.raster.types import Gaussians

Function = Callable[[Sequence[Tensor]], Sequence[Tensor]]


def values_and_gradients(f: Function, inputs: Sequence[Tensor]) -> list[Tensor]:
    """Outputs, and the gradients of a fixed random linear form of them by every input that wants one."""
    leaves = [x.detach().clone().requires_grad_(x.requires_grad) for x in inputs]
    outputs = list(f(leaves))
    generator = torch.Generator().manual_seed(7)
    total = sum((y * torch.randn(y.shape, generator=generator).to(y.dtype)).sum() for y in outputs)
    assert isinstance(total, Tensor)
    wanted = [x for x in leaves if x.requires_grad]
    return [y.detach() for y in outputs] + list(torch.autograd.grad(total, wanted))


def assert_agree(kernel: Function, twin: Function, inputs: Sequence[Tensor], tolerance: float = 1e-5) -> None:
    """float32 through the kernel against float64 through the twin, relative to each tensor's largest value."""
    found = values_and_gradients(kernel, inputs)
    double = [x.detach().double().requires_grad_(x.requires_grad) for x in inputs]
    for a, b in zip(found, values_and_gradients(twin, double), strict=True):
        assert a.dtype == torch.float32
        assert a.shape == b.shape
        if a.numel():
            assert (a - b).abs().max() <= tolerance * b.abs().max().clamp_min(1e-6)


def planes(channels: int, spatial: Sequence[int] = (7, 12), temporal: int = 5) -> list[Tensor]:
    """Six planes of a level, no two of them of one size, with values around those of training."""
    shapes = [(r + 1, r) if i == 0 else (r, r + 2) if i < 3 else (temporal, r + i) for r in spatial for i in range(6)]
    return [(torch.rand(*shape, channels) + 0.5).requires_grad_() for shape in shapes]


@pytest.mark.parametrize("weighted", [True, False])
@pytest.mark.parametrize("channels", [1, 3, 16, 20, 32])
@pytest.mark.parametrize("t", [0.0, 0.37, 1.0])
def test_look_up_agrees_with_its_twin(weighted: bool, channels: int, t: float) -> None:
    torch.manual_seed(0)
    count = 301  # more than one chunk
    u = torch.rand(count, 3) * 2.4 - 1.2  # outside as well
    u[:4] = torch.tensor([[-1.0, 1.0, 0.0], [1.0, 1.0, 1.0], [-1.0, -1.0, -1.0], [0.0, 0.0, 0.0]])
    scores = [torch.randn(count, 6, channels).mul(3).requires_grad_()] if weighted else []

    def run(f: Callable[..., Tensor]) -> Function:
        return lambda x: [f(x[: len(x) - len(scores)], u.to(x[0].dtype), t, x[-1] if weighted else None)]

    # 2e-5: the fraction between two texels has lost the bits of its whole part.
    assert_agree(run(look_up), run(_look_up), [*planes(channels), *scores], 2e-5)


def test_look_up_of_single_texels_and_of_no_anchors() -> None:
    single = [torch.rand(1, 1, 4).requires_grad_() for _ in range(6)]
    u = torch.tensor([[-1.0, 0.3, 1.0]])
    assert_agree(lambda x: [look_up(x, u, 0.5, None)], lambda x: [_look_up(x, u.double(), 0.5, None)], single)
    empty = look_up(single, torch.empty(0, 3), 0.5, torch.empty(0, 6, 4))
    assert empty.shape == (0, 4)
    empty.sum().backward()
    assert all(plane.grad is not None and not plane.grad.any() for plane in single)


def test_zeros_in_a_product_have_finite_gradients() -> None:
    some = planes(4)
    with torch.no_grad():
        some[0].zero_()
        some[4].zero_()
    u = torch.rand(9, 3)
    assert_agree(lambda x: [look_up(x, u, 0.2, None)], lambda x: [_look_up(x, u.double(), 0.2, None)], some)


def test_large_and_infinite_scores_give_one_plane_all_the_weight() -> None:
    some = planes(16)
    u, scores = torch.rand(5, 3), torch.zeros(5, 6, 16)
    scores[:, 2] = 1e30
    scores[:, 5] = -torch.inf
    expected = _look_up(some, u, 0.4, scores)
    torch.testing.assert_close(look_up(some, u, 0.4, scores), expected)


def test_nan_is_not_hidden_and_touches_nothing_outside() -> None:
    some = planes(16)
    scores = torch.zeros(3, 6, 16)
    scores[1, 0, 5] = torch.nan
    u = torch.rand(3, 3)
    h = look_up(some, u, 0.4, scores)
    assert h.isnan().nonzero().tolist() == [[1, 5], [1, 21]]
    u[2] = torch.nan
    assert look_up(some, u, torch.nan, torch.zeros(3, 6, 16))[2].isfinite().all()


def test_look_up_refuses_planes_that_do_not_fit() -> None:
    u = torch.rand(3, 3)
    with pytest.raises(ValueError, match="six planes"):
        look_up(planes(4)[:5], u, 0.5, None)
    with pytest.raises(ValueError, match="scores must be"):
        look_up(planes(4), u, 0.5, torch.zeros(3, 6, 5))


@pytest.mark.parametrize("channels", [1, 16])
def test_the_penalty_agrees_with_its_twin(channels: int) -> None:
    torch.manual_seed(1)
    some = [*planes(channels, (40,)), torch.rand(2, 3, channels).requires_grad_(), torch.ones(4, 3, channels)]
    some[-1].requires_grad_()
    smoothness, constancy = [0.3 + i for i in range(len(some))], [float(i % 3) for i in range(len(some))]
    assert_agree(
        lambda x: [plane_penalty(x, smoothness, constancy)],
        lambda x: [_plane_penalty(x, smoothness, constancy)],
        some,
    )


def network(inputs: int, hidden: int, outputs: int) -> list[Tensor]:
    shapes = ((hidden, inputs), (hidden,), (outputs, hidden), (outputs,))
    return [torch.randn(shape).requires_grad_() for shape in shapes]


@pytest.mark.parametrize("t", [None, 0.6])
@pytest.mark.parametrize(
    ("inputs", "sizes"),
    [
        (32, [(256, 96)]),
        (35, [(32, 10), (32, 30), (32, 70)]),
        (1, [(1, 1)]),
        (0, [(5, 3)]),
        (17, [(47, 15), (3, 49)]),
    ],
)
@pytest.mark.parametrize("rows", [1, 63, 700])
def test_networks_agree_with_their_twin(inputs: int, sizes: list[tuple[int, int]], t: float | None, rows: int) -> None:
    torch.manual_seed(2)
    x = torch.randn(rows, inputs).requires_grad_()
    layers = [tensor for size in sizes for tensor in network(inputs + (t is not None), *size)]

    def run(f: Callable[..., tuple[Tensor, ...]]) -> Function:
        def grouped(tensors: Sequence[Tensor]) -> tuple[Tensor, ...]:
            return f(tensors[0], [tensors[i : i + 4] for i in range(1, len(tensors), 4)], t)

        return grouped

    assert_agree(run(two_layer), run(_two_layer), [x, *layers])


def test_a_network_of_no_rows_has_zero_gradients() -> None:
    layers = network(3, 4, 2)
    (y,) = two_layer(torch.empty(0, 3), [tuple(layers)])  # type: ignore[list-item]
    assert y.shape == (0, 2)
    y.sum().backward()
    assert all(tensor.grad is not None and not tensor.grad.any() for tensor in layers)


def test_a_network_lets_nan_through() -> None:
    x = torch.zeros(70, 3)
    x[66, 1] = torch.nan
    (y,) = two_layer(x, [tuple(network(3, 4, 2))])  # type: ignore[list-item]
    assert y.isnan().any(dim=1).nonzero()[:, 0].tolist() == [66]


@pytest.mark.parametrize("dssim", [0.0, 0.2, 1.0])
@pytest.mark.parametrize("size", [(1, 1), (5, 7), (30, 41), (64, 64)])
def test_the_image_loss_agrees_with_its_twin(size: tuple[int, int], dssim: float) -> None:
    torch.manual_seed(3)
    target = torch.rand(*size, 3)
    image = (target + 0.1 * torch.randn(*size, 3)).clamp(0, 1).requires_grad_()
    _, error = image_loss(image, target, dssim)
    assert not error.requires_grad
    assert error.item() == pytest.approx(_image_loss(image.double(), target.double(), dssim)[1].item(), rel=1e-5)
    assert_agree(
        lambda x: image_loss(x[0], target, dssim)[:1],
        lambda x: _image_loss(x[0], target.double(), dssim)[:1],
        [image],
        1e-4,  # variances are differences of nearly equal means of squares
    )


def test_equal_and_constant_images_lose_nothing() -> None:
    for image in (torch.rand(20, 30, 3), torch.full((20, 30, 3), 0.5)):
        loss, error = image_loss(image.requires_grad_(), image.detach(), 0.2)
        loss.backward()
        assert loss.item() == pytest.approx(0, abs=1e-5)
        assert error.item() == 0
        assert image.grad is not None
        assert image.grad.abs().max() < 1e-4


def test_the_image_loss_shows_nan() -> None:
    image = torch.rand(20, 30, 3)
    image[3, 4, 1] = torch.nan
    assert all(value.isnan() for value in image_loss(image, torch.rand(20, 30, 3), 0.2))


@pytest.mark.parametrize(("anchors", "offsets"), [(1, 1), (7, 3), (300, 10), (0, 10)])
def test_local_gaussians_agree_with_their_twin(anchors: int, offsets: int) -> None:
    torch.manual_seed(4)
    flat = ((anchors, 6), (anchors, offsets), (anchors, 3 * offsets), (anchors, 7 * offsets))
    shapes = ((anchors, 3), (anchors, offsets, 3), *flat)
    inputs = [torch.randn(shape) for shape in shapes]
    inputs[2] = inputs[2].exp()
    for raw in inputs[3:]:
        raw.mul_(10 ** torch.randint(-3, 2, raw.shape).float())  # into saturation, and close to zero
    if anchors:
        inputs[3][0, 0] = 0
    inputs = [x.requires_grad_() for x in inputs]

    def parts(f: Callable[..., Gaussians]) -> Function:
        return lambda x: [value for value in vars(f(*x)).values() if value is not None]

    assert_agree(parts(local_gaussians), parts(_local_gaussians), inputs)


def test_small_opacities_keep_their_bits_and_large_inputs_saturate() -> None:
    raw = torch.tensor([[1e-7, 1e-3, 0.2499, 0.2501, 1.0, 60.0, -60.0, -1e-3, 3e38]])
    color, zeros = raw.repeat(1, 3), torch.zeros(1, 9, 3)
    gaussians = local_gaussians(zeros[0, :1], zeros, torch.ones(1, 6), raw, color, torch.zeros(1, 63))
    expected = raw.double().tanh().clamp_min(0)[0]
    torch.testing.assert_close(gaussians.opacities.double(), expected, rtol=3e-7, atol=0)
    torch.testing.assert_close(gaussians.colors.view(-1), torch.sigmoid(color[0]), rtol=3e-7, atol=1e-30)


ALL_KERNELS = """
import hashlib, sys, torch
from aa4d.kernels.plane_lookup import look_up
from aa4d.kernels.plane_penalty import plane_penalty
from aa4d.kernels.image_loss import image_loss
from aa4d.kernels.local_gaussians import local_gaussians
from aa4d.kernels.two_layer import two_layer
torch.manual_seed(0)
planes = [torch.rand(9, 11, 16).requires_grad_() for _ in range(12)]
x = torch.randn(900, 8).requires_grad_()
layers = [t.requires_grad_() for t in (torch.randn(24, 9), torch.randn(24), torch.randn(96, 24), torch.randn(96))]
image, target = torch.rand(33, 50, 3).requires_grad_(), torch.rand(33, 50, 3)
u = torch.rand(900, 3) * 2 - 1
parts = [torch.randn(s).requires_grad_() for s in ((900, 3), (900, 4, 3), (900, 6), (900, 4), (900, 12), (900, 28))]
for threads in (1, 2, 3, 5):
    torch.set_num_threads(threads)
    scores = two_layer(x, [layers], 0.3)[0].view(-1, 6, 16)
    h = look_up(planes, u, 0.3, scores)
    # No sum of torch's own: it splits what it adds by the number of threads.
    loss = plane_penalty(planes, [1.0] * 12, [1.0] * 12) + image_loss(image, target, 0.2)[0]
    inputs = [*planes, x, *layers]
    gradients = torch.autograd.grad(h, inputs, torch.cos(torch.arange(h.numel())).view_as(h))
    gradients += torch.autograd.grad(loss, [*planes, image])
    means = local_gaussians(*parts).means
    gradients += torch.autograd.grad(means, parts[:3], torch.sin(torch.arange(means.numel())).view_as(means))
    digest = hashlib.sha256(b"".join(v.detach().numpy().tobytes() for v in [h, scores, loss, *gradients]))
    print(digest.hexdigest(), h.double().mean().item())
"""


def test_the_number_of_threads_changes_no_bit_and_instruction_sets_agree() -> None:
    means = []
    for instruction_set in {"portable", "avx2" if _native.field.instruction_set() != "portable" else "portable", ""}:
        result = subprocess.run(
            [sys.executable, "-c", ALL_KERNELS],
            env=os.environ | {"AA4D_SIMD": instruction_set},
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            timeout=120,
            check=True,
        )
        lines = result.stdout.split("\n")[:4]
        assert len(set(lines)) == 1
        means.append(float(lines[0].split()[1]))
    assert means == pytest.approx([means[0]] * len(means), rel=1e-6)


def test_an_instruction_set_that_does_not_exist_is_refused() -> None:
    result = subprocess.run(
        [sys.executable, "-c", "from aa4d import _native; _native.field.instruction_set()"],
        env=os.environ | {"AA4D_SIMD": "mmx"},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert "AA4D_SIMD=mmx: this machine has no such kernels" in result.stderr
