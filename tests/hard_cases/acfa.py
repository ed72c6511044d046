"""ACFA: scores of any size, networks of any shape, and the weights that come of them."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from aa4d.errors import InputError
from aa4d.kernels.plane_lookup import _look_up, look_up
from aa4d.kernels.two_layer import _two_layer, two_layer
from aa4d.methods.adaanchor4d.aggregation import make_aggregation
from aa4d.stress.cases import Part
from tests.hard_cases.errors import against_twin, refusal, relative
from tests.hard_cases.plane_lookup import planes

PART = Part("acfa")


def layers(inputs: int, hidden: int, outputs: int, scale: float = 1.0) -> tuple[Tensor, ...]:
    torch.manual_seed(2)
    shapes = ((hidden, inputs), (hidden,), (outputs, hidden), (outputs,))
    return tuple((torch.randn(shape) * scale).requires_grad_() for shape in shapes)


def network_error(x: Tensor, network: tuple[Tensor, ...], t: float | None, least: float = 1e-6) -> float:
    return against_twin(
        lambda v: two_layer(v[0], [tuple(v[1:])], t),  # type: ignore[list-item]
        lambda v: _two_layer(v[0], [tuple(v[1:])], t),  # type: ignore[list-item]
        [x.requires_grad_(), *network],
        least,
    )


@PART.case(
    why="exp of a large score overflows",
    done="softmax takes the largest score away first",
    bound=2e-5,
    each={f"{size:g}": size for size in (1e-30, 1.0, 90.0, 1e4, 1e30)},
)
def scores_of_size(size: float) -> float:
    generator = torch.Generator().manual_seed(3)
    u, scores = torch.rand(9, 3, generator=generator), torch.randn(9, 6, 16, generator=generator) * size
    return against_twin(
        lambda x: [look_up(x[1:], u, 0.4, x[0])],
        lambda x: [_look_up(x[1:], u.double(), 0.4, x[0])],
        [scores.requires_grad_(), *planes()],
        1.0,  # where one plane has nearly all the weight the scores' gradient is a difference of equal numbers
    )


@PART.case(
    why="one plane has all the weight, another has none at all", done="weights of exactly one and zero", bound=1e-6
)
def infinite_scores() -> float:
    some, u, scores = planes(), torch.rand(5, 3), torch.zeros(5, 6, 16)
    scores[:, 2], scores[:, 5] = 1e30, -math.inf
    return relative(look_up(some, u, 0.4, scores).detach(), _look_up(some, u, 0.4, scores).detach())


@PART.case(why="saturated predictor: scores of 1e10", done="weights finite, of sum one", bound=1e-6)
def saturated_weights() -> float:
    acfa = make_aggregation("acfa", 2, 4, 1)
    torch.nn.init.constant_(acfa.predictor.output.weight, 1e4)  # type: ignore[union-attr,arg-type]
    acfa.predictor.output.weight.data[0] *= 2  # type: ignore[union-attr,index,operator]
    weights = acfa.weights(torch.full((1, 2), 1e3), 1.0)  # type: ignore[operator]
    return math.inf if not weights.isfinite().all() else abs(float(weights.sum().detach()) - 1)


@PART.case(
    why="the network of an anchor block that is not a multiple of a register's width",
    done="rows and columns are padded with zeros",
    bound=1e-5,
    each={f"{n} rows, {i}-{h}-{o}": (n, i, h, o) for n, i, h, o in ((1, 1, 1, 1), (129, 35, 33, 95), (7, 0, 5, 3))},
)
def odd_sizes(shape: tuple[int, int, int, int]) -> float:
    rows, inputs, hidden, outputs = shape
    x = torch.randn(rows, inputs, generator=torch.Generator().manual_seed(4))
    return network_error(x, layers(inputs + 1, hidden, outputs), 0.6)


@PART.case(
    why="embeddings that learning drove to 1e15 or let die to 1e-30",
    done="products in float32, as in torch",
    bound=1e-5,
    each={f"{size:g}": size for size in (1e-30, 1e-15, 1e15)},
)
def embeddings_of_size(size: float) -> float:
    x = torch.randn(70, 8, generator=torch.Generator().manual_seed(5)) * size
    return network_error(x, layers(9, 24, 96), 0.3, 1e-30)


@PART.case(
    why="a hidden layer at exactly zero: which side of the ReLU?", done="no gradient at zero, as in torch", bound=1e-6
)
def hidden_layer_at_zero() -> float:
    network = layers(3, 8, 4)
    with torch.no_grad():
        network[0].zero_()
        network[1].zero_()
    return network_error(torch.randn(5, 3), network, None)


@PART.case(why="a batch without rows", done="empty outputs, zero gradients")
def no_rows() -> float:
    network = layers(3, 4, 2)
    (y,) = two_layer(torch.empty(0, 3), [network])  # type: ignore[list-item]
    assert y.shape == (0, 2)
    y.sum().backward()
    return max(float(tensor.grad.abs().max()) for tensor in network if tensor.grad is not None)


@PART.case(why="a ReLU by comparison turns NaN into zero", done="NaN stays, in its row alone")
def nan_passes_through() -> float:
    x = torch.zeros(70, 3)
    x[66, 1] = math.nan
    (y,) = two_layer(x, [layers(3, 4, 2)])  # type: ignore[list-item]
    return 0.0 if y.isnan().any(dim=1).nonzero()[:, 0].tolist() == [66] else math.inf


@PART.case(why="networks that do not fit their input", done="refused in one sentence")
def layers_that_do_not_fit() -> float:
    return refusal(ValueError, lambda: two_layer(torch.zeros(3, 4), [layers(3, 4, 2)]), "do not fit")  # type: ignore[list-item]


@PART.case(why="a strategy of another name", done="refused with those that exist")
def unknown_aggregation() -> float:
    return refusal(InputError, lambda: make_aggregation("sum", 4, 8, 3), "'sum'", "product")
