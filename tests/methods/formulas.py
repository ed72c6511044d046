"""Formulas that several methods share, written out in loops over floats."""

import math
from typing import Any

import torch
from torch import nn

from aa4d.field.mlp import TwoLayer
from aa4d.field.planes import FeaturePlanes
from aa4d.kernels.plane_lookup import PLANES


def texel(plane: torch.Tensor, a: float, b: float) -> list[float]:
    """Bilinear, border's value outside; `a` runs along columns, both in [-1, 1]."""
    plane = plane.detach()
    rows, columns, channels = plane.shape
    x, y = (min(max((v + 1) / 2 * (size - 1), 0), size - 1) for v, size in ((a, columns), (b, rows)))
    x0, y0 = min(math.floor(x), columns - 2), min(math.floor(y), rows - 2)
    fx, fy = x - x0, y - y0
    return [
        float(
            plane[y0, x0, c] * (1 - fx) * (1 - fy)
            + plane[y0, x0 + 1, c] * fx * (1 - fy)
            + plane[y0 + 1, x0, c] * (1 - fx) * fy
            + plane[y0 + 1, x0 + 1, c] * fx * fy
        )
        for c in range(channels)
    ]


def linear(layer: nn.Linear, x: list[float]) -> list[float]:
    weight, bias = layer.weight.tolist(), layer.bias.tolist()
    return [b + sum(w * v for w, v in zip(row, x, strict=True)) for row, b in zip(weight, bias, strict=True)]


def relu(x: list[float]) -> list[float]:
    return [max(v, 0.0) for v in x]


def two_layer(network: TwoLayer, x: list[float]) -> list[float]:
    return linear(network.output, relu(linear(network.hidden, x)))


def sigmoid(x: float) -> float:
    return 1 / (1 + math.exp(-x))


def product_of_planes(field: FeaturePlanes, place: list[float], t: float) -> list[float]:
    """Each level's six planes multiplied, at a place of the model frame and t in [0, 1]."""
    corners = zip("xyz", *field.box.tolist(), place, strict=True)
    u = {axis: min(max(2 * (p - low) / (high - low) - 1, -1), 1) for axis, low, high, p in corners}
    u["t"] = 2 * t - 1
    features: list[float] = []
    for level in field.by_level():
        product = [1.0] * field.channels
        for plane in PLANES:
            product = [p * v for p, v in zip(product, texel(level[plane], u[plane[0]], u[plane[1]]), strict=True)]
        features += product
    return features


def changed(quaternion: list[float], log_scale: list[float], turn: list[float], growth: list[float]) -> dict[str, Any]:
    """D3DGS's unit quaternion plus a turn, and scale plus a growth, of either sign."""
    norm = math.sqrt(sum(v * v for v in quaternion))
    return {
        "quaternion": [a / norm + b for a, b in zip(quaternion, turn, strict=True)],
        "log_scale": [math.log(abs(math.exp(a) + b)) for a, b in zip(log_scale, growth, strict=True)],
    }
