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


def two_layer(x: Tensor, networks: Sequence[Layers], t: float | None = None) -> tuple[Tensor, ...]:
    """output(relu(hidden([x, t]))) of each network.

    Args:
        x: [N, I], or [N, I - 1] with a time.
        t: a last component of every input, if given.

    Returns:
        [N, O] for each network; differentiable by x and the networks.
    """
    parameters = [tensor for layers in networks for tensor in layers]
    if runs_native(x, *parameters):
        outputs: tuple[Tensor, ...] = _TwoLayer.apply(x, t, *parameters)
        return outputs
    return _two_layer(x, networks, t)


def _two_layer(x: Tensor, networks: Sequence[Layers], t: float | None = None) -> tuple[Tensor, ...]:
    """The twin of `two_layer`."""
    if t is not None:
        x = torch.cat([x, x.new_full((len(x), 1), t)], dim=1)
    return tuple(F.linear(torch.relu(F.linear(x, w1, b1)), w2, b2) for w1, b1, w2, b2 in networks)


def _grouped(tensors: Sequence[Tensor]) -> list[Layers]:
    return [(tensors[i], tensors[i + 1], tensors[i + 2], tensors[i + 3]) for i in range(0, len(tensors), 4)]


class _TwoLayer(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, t: float | None, *parameters: Tensor) -> tuple[Tensor, ...]:
        x, parameters = plain(x), tuple(plain(tensor) for tensor in parameters)
        networks = _grouped(parameters)
        outputs = tuple(torch.empty(len(x), len(layers[3])) for layers in networks)
        _native.field.networks_forward(x, networks, t, torch.get_num_threads(), outputs)
        ctx.t = t
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
            torch.get_num_threads(),
            d_x,
            _grouped(gradients),
        )
        return d_x, None, *gradients
