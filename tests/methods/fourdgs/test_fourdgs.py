"""4D-GS's deformation against its formulas, written out in loops."""

import math
from pathlib import Path

import pytest
import torch
from torch import nn

from aa4d.errors import InputError
from aa4d.kernels.plane_lookup import PLANES
from aa4d.methods.fourdgs.method import METHOD
from aa4d.methods.fourdgs.model import FourDGS, blank_model
from aa4d.methods.fourdgs.settings import ModelConfig

CONFIG = ModelConfig(plane_dim=3, spatial_resolutions=(4, 6), temporal_resolution=5, width=8)


def random_model(config: ModelConfig, n: int = 5) -> FourDGS:
    torch.manual_seed(0)
    model = blank_model(config, n).double()
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.normal_(0, 0.5)
        model.field.box.copy_(torch.tensor([[-1.0, -2, -3], [2, 1, 0.5]]))
    return model


def texel(plane: torch.Tensor, a: float, b: float) -> list[float]:
    """Bilinear, border's value outside; `a` runs along columns, both in [-1, 1]."""
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
    return [
        float(layer.bias[o]) + sum(float(layer.weight[o, i]) * x[i] for i in range(len(x)))
        for o in range(layer.out_features)
    ]


def relu(x: list[float]) -> list[float]:
    return [max(v, 0.0) for v in x]


def test_the_deformation_agrees_with_the_formulas_number_by_number() -> None:
    model, t = random_model(CONFIG), 0.3
    rows = model.free.rows()
    with torch.no_grad():
        after = model.deformed(rows, t)
    corners = list(zip("xyz", *model.field.box.tolist(), strict=True))
    for n in range(len(model)):
        place = rows.position[n].tolist()
        u = {
            axis: min(max(2 * (p - low) / (high - low) - 1, -1), 1)
            for (axis, low, high), p in zip(corners, place, strict=True)
        }
        u["t"] = 2 * t - 1
        features: list[float] = []
        for level in model.field.by_level():
            product = [1.0] * CONFIG.plane_dim
            for plane in PLANES:
                product = [p * v for p, v in zip(product, texel(level[plane], u[plane[0]], u[plane[1]]), strict=True)]
            features += product
        z = relu(linear(model.encoder, features))
        for head, name in (
            (model.head_position, "position"),
            (model.head_log_scale, "log_scale"),
            (model.head_quaternion, "quaternion"),
        ):
            change = linear(head.output, relu(linear(head.hidden, z)))
            expected = [a + b for a, b in zip(getattr(rows, name)[n].tolist(), change, strict=True)]
            got = getattr(after, name)[n].tolist()
            assert all(math.isclose(a, b, rel_tol=1e-9, abs_tol=1e-9) for a, b in zip(got, expected, strict=True)), name
    for name in ("opacity", "sh_constant", "sh_rest"):
        assert torch.equal(getattr(after, name), getattr(rows, name))


def test_gradients_are_those_of_finite_differences() -> None:
    config = ModelConfig(plane_dim=2, spatial_resolutions=(4,), temporal_resolution=5, width=4, learn_lookup=True)
    model = random_model(config, n=2)
    with torch.no_grad():
        model.free.position.copy_(torch.tensor([[0.11, -0.47, -1.02], [0.83, 0.31, -0.55]]))
    owned = [model.free.position, model.free.log_scale, model.free.quaternion]
    shared = [*model.field.parameters(), *model.encoder.parameters()]

    def moved(*_: torch.Tensor) -> tuple[torch.Tensor, ...]:
        after = model.deformed(model.free.rows(), 0.4)
        return after.position, after.log_scale, after.quaternion

    assert torch.autograd.gradcheck(moved, (*owned, *shared))


@pytest.mark.parametrize("degree", [-1, 4, 10**9])
def test_harmonics_of_a_degree_that_there_is_not_are_refused(degree: int) -> None:
    model = random_model(CONFIG)
    METHOD.check(model, Path("model.safetensors"))
    model.degree.fill_(degree)
    with pytest.raises(InputError, match=f"degree is {degree}, expected 0 to 3"):
        METHOD.check(model, Path("model.safetensors"))
