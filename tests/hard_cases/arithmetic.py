"""The networks in bfloat16: numbers at the ends of its range, sums that cancel, and what a rounding may not hide."""

from __future__ import annotations

import math
import tempfile
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path

import torch
from torch import Tensor

from aa4d.field.mlp import use_arithmetic
from aa4d.kernels.plane_lookup import _look_up
from aa4d.kernels.two_layer import _two_layer, two_layer
from aa4d.methods.adaanchor4d.aggregation import make_aggregation
from aa4d.stress.cases import Part
from aa4d.stress.hostile import write_hostile_capture
from aa4d.stress.long_run import settings_of, train
from tests.hard_cases.acfa import layers
from tests.hard_cases.errors import against_twin, relative, values_and_gradients

PART = Part("arithmetic")
ROUNDOFF = 2.0**-9  # of one rounding to the nearest of 8 significant bits
LARGEST = 3.3895313892515355e38  # that bfloat16 has; float32 has 0.4 % more
SMALLEST = 2.0**-126  # with all its digits


def rounded(x: Tensor, network: tuple[Tensor, ...], t: float | None = None) -> Tensor:
    return two_layer(x, [network], t, "bfloat16")[0]  # type: ignore[list-item]


def error(x: Tensor, network: tuple[Tensor, ...], t: float | None = None, least: float = 1e-6) -> float:
    """Against the twin, which rounds at the same places. One sum that rounds to the other side is off by `ROUNDOFF`."""
    return against_twin(
        lambda v: two_layer(v[0], [tuple(v[1:])], t, "bfloat16"),  # type: ignore[list-item]
        lambda v: _two_layer(v[0], [tuple(v[1:])], t, "bfloat16"),  # type: ignore[list-item]
        [x.requires_grad_(), *network],
        least,
    )


def inputs(rows: int, columns: int, size: float = 1.0) -> Tensor:
    return torch.randn(rows, columns, generator=torch.Generator().manual_seed(6)) * size


@PART.case(
    why="a large hidden layer swallows the bias; a small one is swallowed",
    done="biases and sums in float32",
    bound=2 * ROUNDOFF,
    each={f"{size:g}": size for size in (1e-30, 1e-15, 1e15, 1e30)},
)
def inputs_of_size(size: float) -> float:
    return error(inputs(70, 8, size), layers(9, 24, 96), 0.3, 1e-30)


@PART.case(
    why="weights that learning drove far, or let die",
    done="bfloat16 has the exponents of float32",
    bound=2 * ROUNDOFF,
    each={f"{scale:g}": scale for scale in (1e-15, 1e-6, 1e6, 1e12)},
)
def weights_of_size(scale: float) -> float:
    return error(inputs(70, 8), layers(8, 24, 5, scale), None, 1e-30)


@PART.case(
    why="gradients that a loss scaled up or down",
    done="rounded to 8 bits at any size, never to a smallest step",
    bound=4 * ROUNDOFF,
    each={f"{size:g}": size for size in (1e-30, 1e-12, 1e12, 1e30)},
)
def gradients_of_size(size: float) -> float:
    x, network = inputs(70, 8).requires_grad_(), layers(8, 24, 5)
    of_one = values_and_gradients(lambda v: [rounded(v[0], tuple(v[1:]))], [x, *network])
    scaled = values_and_gradients(lambda v: [rounded(v[0], tuple(v[1:])) * size], [x, *network])
    return max(relative(a / size, b) for a, b in zip(scaled[1:], of_one[1:], strict=True))


@PART.case(
    why="the largest number of bfloat16 times a small weight",
    done="not rounded up to infinity",
    bound=4 * ROUNDOFF,
    each={"+": 1.0, "-": -1.0},
)
def largest_number(sign: float) -> float:
    network = layers(3, 4, 2, 1e-20)
    return relative(
        rounded(torch.full((9, 3), sign * LARGEST), network).detach(),
        _two_layer(torch.full((9, 3), sign * LARGEST).double(), [tuple(p.double() for p in network)])[0].detach(),  # type: ignore[list-item]
        1e-30,
    )


@PART.case(
    why="numbers below the smallest with all its digits",
    done="nothing or themselves, as the processor has it: never larger",
    bound=2 * SMALLEST,
    each={f"{size:g}": size for size in (1e-45, 1e-40, 1e-38)},
)
def denormal(size: float) -> float:
    one = torch.ones(1, 1)
    found = rounded(torch.full((5, 1), size), (one, torch.zeros(1), one, torch.zeros(1)))
    return float((found - size).abs().max()) if found.isfinite().all() else math.inf


@PART.case(why="networks of zeros", done="exactly the last bias, and gradients of exactly zero")
def all_zero_networks() -> float:
    network = tuple(torch.zeros_like(p).requires_grad_() for p in layers(7, 24, 5))
    x = inputs(70, 7).requires_grad_()
    with torch.no_grad():
        network[3].copy_(torch.linspace(-1, 1, 5))
    y = rounded(x, network)
    first, *others = torch.autograd.grad(y.sum(), [x, *network[:3]])
    wrong = [(y - network[3]).abs().max(), first.abs().max(), *(g.abs().max() for g in others)]
    return float(torch.stack(wrong).max().detach())


@PART.case(why="inputs of zeros", done="what the biases make", bound=2 * ROUNDOFF, each={"0": 0.0, "-0": -0.0})
def all_zero_inputs(zero: float) -> float:
    return error(torch.full((70, 8), zero), layers(9, 24, 5), 0.3)


@PART.case(why="no hidden unit is above zero", done="the last bias; gradients of zero, none of them NaN")
def dead_networks() -> float:
    network = layers(8, 24, 5)
    with torch.no_grad():
        network[1].fill_(-1e6)
    x = inputs(70, 8).requires_grad_()
    y = rounded(x, network)
    gradients = torch.autograd.grad(y.sum(), [x, *network[:3]])
    return max(float((y - network[3]).detach().abs().max()), *(float(g.abs().max()) for g in gradients))


@PART.case(
    why="products that cancel: rounding 1 + 2^-9 loses what is left",
    done="four roundings of the terms' sizes at most, as error analysis has it",
    bound=4.1 * ROUNDOFF,
)
def sums_that_cancel() -> float:
    x = inputs(200, 16)
    x = torch.cat([1e4 * x, -1e4 * x * (1 + 2.0**-9)], dim=1)
    network = layers(32, 24, 5)
    double = [p.detach().double() for p in network]
    truth = _two_layer(x.double(), [tuple(double)])[0]  # type: ignore[list-item]
    w1, b1, w2, _ = (p.abs() for p in double)
    terms = (x.double().abs() @ w1.T + b1) @ w2.T
    return float(((rounded(x, network).detach().double() - truth).abs() / terms).max())


@PART.case(why="saturated predictor: scores of 1e10", done="weights finite, of sum one", bound=1e-6)
def saturated_weights() -> float:
    acfa = make_aggregation("acfa", 2, 4, 1)
    use_arithmetic(acfa, "bfloat16")
    torch.nn.init.constant_(acfa.predictor.output.weight, 1e4)  # type: ignore[union-attr,arg-type]
    acfa.predictor.output.weight.data[0] *= 2  # type: ignore[union-attr,index,operator]
    weights = acfa.weights(torch.full((1, 2), 1e3), 1.0)  # type: ignore[operator]
    return math.inf if not weights.isfinite().all() else abs(float(weights.sum().detach()) - 1)


@PART.case(
    why="odd numbers of inputs and hidden units: numbers go in pairs",
    done="the last pair is filled up with zero",
    bound=2 * ROUNDOFF,
    each={f"{n} rows, {i}-{h}-{o}": (n, i, h, o) for n, i, h, o in ((1, 1, 1, 1), (129, 35, 33, 95), (7, 0, 5, 3))},
)
def odd_sizes(shape: tuple[int, int, int, int]) -> float:
    rows, columns, hidden, outputs = shape
    return error(inputs(rows, columns), layers(columns + 1, hidden, outputs), 0.6)


@PART.case(
    why="a rounding that turns NaN into a number, or a padded row that spreads it",
    done="NaN and infinity stay, in their row alone",
    each={"nan": math.nan, "inf": math.inf},
)
def not_finite_stays(value: float) -> float:
    x = torch.zeros(70, 3)
    x[66, 1] = value
    ones = tuple(torch.ones_like(p) for p in layers(3, 4, 2))
    bad = ~rounded(x, ones).isfinite().all(dim=1)
    return 0.0 if bad.nonzero()[:, 0].tolist() == [66] else math.inf


@PART.case(
    why="numbers that float32 has and bfloat16 has not",
    done="not finite, which the watchdog sees, and no number that is wrong",
    each={"3.4e38": 3.4e38, "-3.4e38": -3.4e38},
)
def beyond_the_largest(value: float) -> float:
    one = torch.ones(1, 1)
    network = (one * math.copysign(1.0, value), torch.zeros(1), one * 1e-10, torch.zeros(1))
    return math.inf if rounded(torch.full((3, 1), value), network).isfinite().any() else 0.0


@PART.case(why="a batch without rows", done="empty outputs, zero gradients")
def no_rows() -> float:
    network = layers(3, 4, 2)
    y = rounded(torch.empty(0, 3), network)
    assert y.shape == (0, 2)
    y.sum().backward()
    return max(float(tensor.grad.abs().max()) for tensor in network if tensor.grad is not None)


@PART.case(
    why="thin objects, a white and a black frame, an exposure jump, a camera at a wall: 1,000 iterations of all that",
    done="a run ends at the first value that is not finite: none is met",
    is_slow=True,
)
def hostile_training() -> float:
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(StringIO()):
        write_hostile_capture(Path(folder, "capture"))
        rows = train(Path(folder), replace(settings_of(1000, 0), arithmetic="bfloat16"))
    is_finite = all(math.isfinite(row["largest_loss"]) for row in rows)
    return 0.0 if is_finite and rows[-1]["step"] == 1000 else math.inf


@PART.case(
    why="PyTorch counts a 16-bit plane's numbers with 16 bits: beyond 32,767 it reads outside the plane",
    done="the twin interpolates in float32",
    bound=4 * ROUNDOFF,
    each={"64 x 64 x 16": 64, "200 x 200 x 16": 200},
)
def planes_in_bfloat16(resolution: int) -> float:
    generator = torch.Generator().manual_seed(8)
    texels = [(torch.rand(resolution, resolution, 16, generator=generator) + 0.5).bfloat16() for _ in range(6)]
    leaves = [texel.requires_grad_() for texel in texels]
    u = (torch.rand(300, 3, generator=generator) * 2 - 1).bfloat16()
    scores = torch.randn(300, 6, 16, generator=generator).bfloat16()

    def run(x: list[Tensor]) -> list[Tensor]:
        return [_look_up(x, u.to(x[0]), 0.75, scores.to(x[0]))]

    found = values_and_gradients(run, leaves)  # type: ignore[arg-type]
    truth = values_and_gradients(run, [leaf.detach().double().requires_grad_() for leaf in leaves])  # type: ignore[arg-type]
    return max(relative(a, b) for a, b in zip(found, truth, strict=True))
