"""Every fused kernel against its float64 twin, gradients included; the same bits from any threads."""

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
from tests.hard_cases.errors import Function, against_twin


def assert_agree(kernel: Function, twin: Function, inputs: Sequence[Tensor], tolerance: float = 1e-5) -> None:
    """float32 through the kernel against float64 through the twin, relative to each tensor's largest value."""
    assert against_twin(kernel, twin, inputs) <= tolerance


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


@pytest.mark.parametrize("zeros", ["none", "first", "every third", "all but one", "all", "minus zero"])
def test_rows_without_a_gradient_change_no_bit_of_the_others(zeros: str) -> None:
    torch.manual_seed(6)
    x, layers = torch.randn(120, 9), network(9, 24, 5)
    push = torch.randn(120, 5)
    rows = torch.arange(120)
    hidden = {"none": rows < 0, "first": rows < 50, "every third": rows % 3 == 0, "minus zero": rows % 2 == 0}
    zero = hidden.get(zeros, rows != 7 if zeros == "all but one" else rows >= 0)
    push[zero] = -0.0 if zeros == "minus zero" else 0.0

    def gradients(rows: Tensor) -> list[Tensor]:
        seen = x[rows].requires_grad_()
        (y,) = two_layer(seen, [(layers[0], layers[1], layers[2], layers[3])])
        return list(torch.autograd.grad((y * push[rows]).sum(), [seen, *layers]))

    whole, part = gradients(rows), gradients(rows[~zero])
    assert torch.equal(whole[0][~zero], part[0])
    assert (whole[0][zero] == 0).all()
    assert all(torch.equal(a, b) for a, b in zip(whole[1:], part[1:], strict=True))


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
