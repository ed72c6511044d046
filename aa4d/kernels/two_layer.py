"""Small networks of two linear layers with a ReLU between them, several of one input at a time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor
from torch.autograd.function import once_differentiable

from aa4d import _native
from aa4d.kernels import plain, runs_native

Layers = tuple[Tensor, Tensor, Tensor, Tensor]  # weight [H, I], bias [H] of the hidden layer; [O, H], [O] of the output


# Of the networks' products. bfloat16 rounds both factors to 8 significant bits, of every product in either direction,
# and sums in float32; weights, biases and their gradients stay float32.
ARITHMETIC = ("float32", "bfloat16")


def two_layer(
    x: Tensor, networks: Sequence[Layers], t: float | None = None, arithmetic: str = "float32"
) -> tuple[Tensor, ...]:
    """output(relu(hidden([x, t]))) of each network.

    Args:
        x: [N, I], or [N, I - 1] with a time.
        t: a last component of every input, if given; never rounded.
        arithmetic: of `ARITHMETIC`.

    Returns:
        [N, O] for each network; differentiable by x and the networks.
    """
    parameters = [tensor for layers in networks for tensor in layers]
    if runs_native(x, *parameters):
        outputs: tuple[Tensor, ...] = _TwoLayer.apply(x, t, arithmetic == "bfloat16", *parameters)
        return outputs
    return _two_layer(x, networks, t, arithmetic)


def _two_layer(
    x: Tensor, networks: Sequence[Layers], t: float | None = None, arithmetic: str = "float32"
) -> tuple[Tensor, ...]:
    """The twin of `two_layer`."""
    if arithmetic == "bfloat16":
        return tuple(_rounded_network(x, layers, t) for layers in networks)
    if t is not None:
        x = torch.cat([x, x.new_full((len(x), 1), t)], dim=1)
    return tuple(F.linear(torch.relu(F.linear(x, w1, b1)), w2, b2) for w1, b1, w2, b2 in networks)


def _rounded_network(x: Tensor, layers: Layers, t: float | None) -> Tensor:
    w1, b1, w2, b2 = layers
    if t is not None:
        w1, b1 = w1[:, :-1], b1 + t * w1[:, -1]
    return _rounded_product(torch.relu(_rounded_product(x, w1) + b1), w2) + b2


def _rounded_product(x: Tensor, weight: Tensor) -> Tensor:
    """x weight^T of numbers rounded to bfloat16; so are the gradient and its factors on the way back."""
    product: Tensor = _RoundedBackward.apply(F.linear(_Rounded.apply(x), _Rounded.apply(weight)))
    return product


class _Rounded(torch.autograd.Function):
    @staticmethod
    def forward(_ctx: Any, x: Tensor) -> Tensor:
        return x.bfloat16().to(x.dtype)

    @staticmethod
    def backward(_ctx: Any, gradient: Tensor) -> Tensor:
        return gradient


class _RoundedBackward(torch.autograd.Function):
    @staticmethod
    def forward(_ctx: Any, x: Tensor) -> Tensor:
        return x.view_as(x)

    @staticmethod
    def backward(_ctx: Any, gradient: Tensor) -> Tensor:
        return gradient.bfloat16().to(gradient.dtype)


def _grouped(tensors: Sequence[Tensor]) -> list[Layers]:
    return [(tensors[i], tensors[i + 1], tensors[i + 2], tensors[i + 3]) for i in range(0, len(tensors), 4)]


class _TwoLayer(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, t: float | None, bfloat16: bool, *parameters: Tensor) -> tuple[Tensor, ...]:
        x, parameters = plain(x), tuple(plain(tensor) for tensor in parameters)
        networks = _grouped(parameters)
        outputs = tuple(torch.empty(len(x), len(layers[3])) for layers in networks)
        _native.field.networks_forward(x, networks, t, bfloat16, torch.get_num_threads(), outputs)
        ctx.t, ctx.bfloat16 = t, bfloat16
        ctx.save_for_backward(x, *parameters)
        return outputs

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *d_outputs: Tensor) -> tuple[Tensor | None, ...]:
        x, *parameters = ctx.saved_tensors
        d_x = torch.empty_like(x) if ctx.needs_input_grad[0] else None
        gradients = [torch.empty_like(tensor) for tensor in parameters]
        _native.field.networks_backward(
            x,
            _grouped(parameters),
            ctx.t,
            [plain(d) for d in d_outputs],
            ctx.bfloat16,
            torch.get_num_threads(),
            d_x,
            _grouped(gradients),
        )
        return d_x, None, None, *gradients
