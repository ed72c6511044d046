"""4D-GS's deformation against its formulas, written out in loops."""

import math
from pathlib import Path

import pytest
import torch

from aa4d.errors import InputError
from aa4d.methods.fourdgs.method import METHOD
from aa4d.methods.fourdgs.model import FourDGS, blank_model
from aa4d.methods.fourdgs.settings import ModelConfig
from tests.methods.formulas import linear, product_of_planes, relu, two_layer

CONFIG = ModelConfig(plane_dim=3, spatial_resolutions=(4, 6), temporal_resolution=5, width=8)


def random_model(config: ModelConfig, n: int = 5) -> FourDGS:
    torch.manual_seed(0)
    model = blank_model(config, n).double()
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.normal_(0, 0.5)
        model.field.box.copy_(torch.tensor([[-1.0, -2, -3], [2, 1, 0.5]]))
    return model


def test_the_deformation_agrees_with_the_formulas_number_by_number() -> None:
    model, t = random_model(CONFIG), 0.3
    rows = model.free.rows()
    with torch.no_grad():
        after = model.deformed(rows, t)
    for n in range(len(model)):
        z = relu(linear(model.encoder, product_of_planes(model.field, rows.position[n].tolist(), t)))
        for head, name in (
            (model.head_position, "position"),
            (model.head_log_scale, "log_scale"),
            (model.head_quaternion, "quaternion"),
        ):
            change = two_layer(head, z)
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
