"""The networks' bfloat16 arithmetic: a bound on its error, the twin that rounds at the same places, the emulation."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Sequence

import pytest
import torch
from torch import Tensor, nn

from aa4d import _native
from aa4d.field.mlp import TwoLayer, evaluate_together, use_arithmetic
from aa4d.kernels.two_layer import _two_layer, two_layer
from tests.hard_cases.errors import Function, against_twin

ROUNDOFF = 2.0**-9  # of one rounding to the nearest of 8 significant bits

SHAPES = [(32, [(256, 96)]), (35, [(32, 10), (32, 70)]), (128, [(128, 3), (128, 32)]), (17, [(47, 15), (3, 49)])]


def network(inputs: int, hidden: int, outputs: int) -> list[Tensor]:
    scales = ((hidden, inputs), (hidden,), (outputs, hidden), (outputs,))
    return [(torch.randn(shape) / shape[-1] ** 0.5).requires_grad_() for shape in scales]


def grouped(tensors: Sequence[Tensor]) -> list[tuple[Tensor, ...]]:
    return [tuple(tensors[i : i + 4]) for i in range(0, len(tensors), 4)]


def outputs_of(f: Callable[..., tuple[Tensor, ...]], t: float | None) -> Function:
    return lambda x: f(x[0], grouped(x[1:]), t, "bfloat16")


@pytest.mark.parametrize("t", [None, 0.6])
@pytest.mark.parametrize(("inputs", "sizes"), SHAPES)
@pytest.mark.parametrize("rows", [1, 7, 300])
def test_no_value_is_off_by_more_than_four_roundings_of_its_terms(
    inputs: int, sizes: list[tuple[int, int]], t: float | None, rows: int
) -> None:
    """|error| <= 4 u (|W2| (|W1| |x| + |b1|)) + O(u^2): x, W1, the hidden layer and W2 are each rounded once."""
    torch.manual_seed(0)
    x = torch.randn(rows, inputs) * torch.logspace(-3, 3, rows)[:, None]
    for hidden, outputs in sizes:
        layers = network(inputs + (t is not None), hidden, outputs)
        found = two_layer(x, [tuple(layers)], t, "bfloat16")[0].double()  # type: ignore[list-item]
        double = [p.detach().double() for p in layers]
        truth = _two_layer(x.double(), [tuple(double)], t)[0]  # type: ignore[list-item]
        w1, b1, w2, _ = (p.abs() for p in double)
        seen = x.double().abs() if t is None else torch.cat([x.double().abs(), torch.full((rows, 1), t)], dim=1)
        terms = (seen @ w1.T + b1) @ w2.T
        assert (found - truth).abs().div(terms).max() <= 4.1 * ROUNDOFF


@pytest.mark.parametrize("t", [None, 0.6])
@pytest.mark.parametrize(("inputs", "sizes"), [*SHAPES, (1, [(1, 1)]), (0, [(5, 3)])])
@pytest.mark.parametrize("rows", [0, 1, 63, 700])
def test_values_and_gradients_are_those_of_the_twin_that_rounds(
    inputs: int, sizes: list[tuple[int, int]], t: float | None, rows: int
) -> None:
    torch.manual_seed(2)
    x = torch.randn(rows, inputs).requires_grad_()
    layers = [tensor for size in sizes for tensor in network(inputs + (t is not None), *size)]
    error = against_twin(outputs_of(two_layer, t), outputs_of(_two_layer, t), [x, *layers])
    # A sum that float32 and float64 round apart to bfloat16 differs by a rounding, in a few elements.
    assert error <= ROUNDOFF


def test_the_gradient_of_the_exact_network_is_met_to_a_percent() -> None:
    """In the norm: single elements change with the sign of a hidden unit near zero."""
    torch.manual_seed(3)
    x, layers = torch.randn(2000, 32).requires_grad_(), network(33, 256, 96)
    exact = [p.detach().double().requires_grad_() for p in (x, *layers)]
    push = torch.randn(2000, 96)
    (two_layer(x, [tuple(layers)], 0.4, "bfloat16")[0] * push).sum().backward()  # type: ignore[list-item]
    (_two_layer(exact[0], [tuple(exact[1:])], 0.4)[0] * push).sum().backward()  # type: ignore[list-item]
    for found, truth in zip((x, *layers), exact, strict=True):
        assert found.grad is not None
        assert truth.grad is not None
        assert (found.grad - truth.grad).norm() <= 0.06 * truth.grad.norm()


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_what_is_not_finite_stays_so(value: float) -> None:
    x = torch.zeros(9, 3)
    x[4, 1] = value
    ones = torch.ones(2, 3), torch.zeros(2), torch.ones(1, 2), torch.zeros(1)
    y = two_layer(x, [ones], None, "bfloat16")[0][:, 0]
    assert torch.equal(y.isfinite().nonzero()[:, 0], torch.tensor([0, 1, 2, 3, 5, 6, 7, 8])) or value < 0
    assert y[4].item() == 0.0 if value < 0 else not y[4].isfinite()  # the ReLU of minus infinity is zero


SAME_EVERYWHERE = """
import sys, torch
from aa4d import _native
from aa4d.kernels.two_layer import two_layer
torch.manual_seed(0)
x = torch.randn(500, 35, requires_grad=True)
layers = [torch.randn(s, requires_grad=True) for s in ((48, 36), (48,), (21, 48), (21,))]
values = []
for threads in (1, 3):
    torch.set_num_threads(threads)
    y = two_layer(x, [layers], 0.3, "bfloat16")[0]
    values.append([y.detach(), *torch.autograd.grad(y.square().sum(), [x, *layers])])
assert all(torch.equal(a, b) for a, b in zip(*values)), "bits differ with the number of threads"
torch.save((_native.field.bfloat16_in_hardware(), values[0]), sys.argv[1])
"""


def test_every_instruction_set_agrees_and_no_number_of_threads_changes_a_bit(tmp_path) -> None:  # type: ignore[no-untyped-def]
    results = {}
    for simd in {"portable", "avx2", "avx512", _native.field.instruction_set()}:
        path = tmp_path / simd
        run = subprocess.run(
            [sys.executable, "-c", SAME_EVERYWHERE, str(path)],
            env=os.environ | {"AA4D_SIMD": simd},
            capture_output=True,
            text=True,
        )
        if "this machine has no such kernels" in run.stderr:
            continue
        assert run.returncode == 0, run.stderr
        results[simd] = torch.load(path, weights_only=True)
    for simd, (in_hardware, values) in results.items():
        assert not in_hardware or simd == "avx512"  # whatever AA4D_SIMD was for this process
        for found, expected in zip(values, results["portable"][1], strict=True):
            assert (found - expected).abs().max() <= ROUNDOFF * expected.abs().max()


def test_a_model_is_told_its_arithmetic_and_float32_is_what_it_starts_with() -> None:
    torch.manual_seed(5)
    model = nn.ModuleList([TwoLayer(8, 16, 4), TwoLayer(8, 16, 4)])
    x = torch.randn(20, 8)
    first, second = (module for module in model if isinstance(module, TwoLayer))
    exact = evaluate_together((first, second), x)
    assert torch.equal(exact[0], two_layer(x, [first.layers()])[0])
    use_arithmetic(model, "bfloat16")
    rounded = evaluate_together((first, second), x)
    assert torch.equal(rounded[1], two_layer(x, [second.layers()], None, "bfloat16")[0])
    assert torch.equal(rounded[0], first(x))
    assert not torch.equal(rounded[0], exact[0])
    use_arithmetic(model, "float32")
    assert torch.equal(first(x), exact[0])
