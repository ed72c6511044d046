"""MoDec-GS's two deformations against their formulas, written out in loops; its gates, its rates and its growth."""

import math
from dataclasses import replace
from typing import Any

import pytest
import torch

from aa4d.anchors.densification import Statistics
from aa4d.methods.modec.deformation import start_of_interval
from aa4d.methods.modec.method import METHOD
from aa4d.methods.modec.model import Config, Modec, blank_model
from aa4d.methods.modec.settings import PRESETS, FieldConfig, ModelConfig
from aa4d.raster.types import Camera, Gaussians
from tests.methods.formulas import linear, product_of_planes, relu, sigmoid, two_layer

EYE = [0.3, -0.2, -4.0]


def config(**switches: Any) -> Config:
    model = ModelConfig(offsets=2, feature_dim=3, decoder_hidden=5, **switches)
    return Config(model, FieldConfig(3, (4, 6), 5, 8), FieldConfig(2, (5,), 4, 6))


def random_model(n: int = 6, of: Config | None = None, **switches: Any) -> Modec:
    torch.manual_seed(1)
    model = blank_model(of or config(**switches), n).double()
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.normal_(0, 0.6)
        model.anchors.position.normal_(0, 0.7)
        model.decoder.opacity.output.weight.mul_(0.1)
        model.decoder.opacity.output.bias.copy_(torch.tensor([1.0, -1.0]))  # the second Gaussian is not drawn
    model.set_box(torch.tensor([[-1.0, -2, -3], [2, 1, 0.5]]))
    return model


def camera() -> Camera:
    viewmat = torch.eye(4, dtype=torch.float64)
    viewmat[:3, 3] = -torch.tensor(EYE, dtype=torch.float64)
    return Camera(viewmat, torch.eye(3, dtype=torch.float64), 8, 8)


def add(a: list[float], b: list[float], factor: float = 1.0) -> list[float]:
    return [x + factor * y for x, y in zip(a, b, strict=True)]


def slowly(model: Modec, t: float) -> list[dict[str, list[float]]]:
    """What each Gaussian looks like at t."""
    c, anchors, result = model.config.model, model.anchors, []
    for n in range(len(model)):
        position, feature = anchors.position[n].tolist(), anchors.feature[n].tolist()
        offset, scale = anchors.offset[n].flatten().tolist(), anchors.log_scale[n].exp().tolist()
        steps: list[tuple[Any, float]] = [(model.gad, math.floor(t * c.intervals) / c.intervals)] if c.gad else []
        steps += [(model.lgd, t)] if c.lgd == "anchors" else []
        for stage, when in steps:
            z = relu(linear(stage.encoder, product_of_planes(stage.field, position, when)))
            first, second = [sigmoid(v) for v in anchors.dynamics[n].tolist()] if c.gates else (1.0, 1.0)
            position = add(position, two_layer(stage.head_position, z), 1.0 if first > 0.01 else 0.0)
            feature = add(feature, two_layer(stage.head_feature, z), second)
            offset = add(offset, two_layer(stage.head_offset, z), second)
            scale = add(scale, two_layer(stage.head_scale, z), second)
        toward = [a - b for a, b in zip(position, EYE, strict=True)]
        view = feature + [v / math.hypot(*toward) for v in toward]
        opacity, color, covariance = (
            two_layer(network, view)
            for network in (model.decoder.opacity, model.decoder.color, model.decoder.covariance)
        )
        for k in range(c.offsets):
            shares, turn = covariance[7 * k : 7 * k + 3], covariance[7 * k + 3 : 7 * k + 7]
            place = [position[i] + offset[3 * k + i] * scale[i] for i in range(3)]
            size = [scale[3 + i] * sigmoid(shares[i]) for i in range(3)]
            if c.lgd == "gaussians":
                z = relu(linear(model.lgd.encoder, product_of_planes(model.lgd.field, place, t)))
                place, size, turn = (
                    add(value, two_layer(head, z))
                    for value, head in (
                        (place, model.lgd.head_position),
                        (size, model.lgd.head_scale),
                        (turn, model.lgd.head_quaternion),
                    )
                )
            result.append(
                {
                    "means": place,
                    "scales": [abs(v) for v in size],
                    "quaternions": turn,
                    "opacities": [max(math.tanh(opacity[k]), 0.0)],
                    "colors": [sigmoid(v) for v in color[3 * k : 3 * k + 3]],
                }
            )
    return result


@pytest.mark.parametrize(
    "switches",
    [{}, {"gates": False}, {"gad": False}, {"lgd": "none"}, {"lgd": "anchors"}, {"gad": False, "lgd": "anchors"}],
    ids=str,
)
def test_gaussians_agree_with_the_formulas_number_by_number(switches: dict[str, Any]) -> None:
    model, t = random_model(**switches), 0.3
    if model.anchors.dynamics is not None:
        model.anchors.dynamics.data[1, 0] = -5  # its first gate is closed
    with torch.no_grad():
        got = model.gaussians(t, camera())
    drawn = 0
    for row, expected in enumerate(slowly(model, t)):
        if expected["opacities"] == [0.0]:
            assert got.opacities[row] == 0
            continue
        drawn += 1
        for name, values in expected.items():
            assert getattr(got, name)[row].flatten().tolist() == pytest.approx(values, rel=1e-9, abs=1e-9), name
    assert drawn == len(model)


def test_gradients_are_those_of_finite_differences() -> None:
    tiny = ModelConfig(offsets=2, feature_dim=2, decoder_hidden=2, learn_lookup=True)
    model = random_model(2, Config(tiny, FieldConfig(1, (3,), 3, 2), FieldConfig(1, (3,), 3, 2)))
    owned = [model.anchors.feature, model.anchors.offset, model.anchors.log_scale]
    shared = [parameter for deformation in model.deformations() for parameter in deformation.parameters()]

    def drawn(*_: torch.Tensor) -> tuple[torch.Tensor, ...]:
        g = model.gaussians(0.4, camera())
        alive = g.opacities > 0
        assert alive.sum() == len(model)
        return g.means[alive], g.scales[alive], g.quaternions[alive], g.opacities[alive], g.colors[alive]

    assert torch.autograd.gradcheck(drawn, (*owned, *shared), fast_mode=True)


def test_the_first_gate_is_open_or_closed_and_learns_as_a_sigmoid() -> None:
    model = random_model(lgd="none")
    assert model.anchors.dynamics is not None
    rows = model.anchors.rows()
    for logit, open_ in ((-5.0, 0.0), (-4.0, 1.0), (0.0, 1.0)):
        model.anchors.dynamics.data[:, 0] = logit
        rows = model.anchors.rows()
        moved = model.deformed(rows, 0.3).position - rows.position
        model.anchors.dynamics.data[:, 0] = 5
        free = model.deformed(model.anchors.rows(), 0.3).position - rows.position
        assert torch.allclose(moved, open_ * free)
        (gradient,) = torch.autograd.grad(moved.sum(), model.anchors.dynamics)
        share = sigmoid(logit)
        assert torch.allclose(gradient[:, 0], free.sum(1) * share * (1 - share))


def test_the_global_deformation_is_the_same_over_an_interval() -> None:
    assert [start_of_interval(t, 8) for t in (0, 0.1, 0.125, 0.99, 1)] == [0, 0, 0.125, 0.875, 0.875]
    model = random_model(lgd="none", intervals=4)

    def at(t: float) -> Gaussians:
        with torch.no_grad():
            return model.gaussians(t, camera())

    assert torch.equal(at(0.26).means, at(0.49).means)
    assert not torch.allclose(at(0.26).means, at(0.51).means)


def test_every_parameter_learns_at_the_rate_that_the_published_code_has_for_it() -> None:
    for switches in ({}, {"lgd": "anchors"}, {"gad": False}, {"gates": False}):
        model = random_model(**switches)
        groups = model.parameter_groups(canonical=False)
        grouped = [id(p) for parameters in groups.values() for p in parameters]
        assert sorted(grouped) == sorted(id(p) for p in model.parameters())
    groups = random_model().parameter_groups(canonical=False)
    assert [tuple(p.shape) for p in groups["geometry"]][2::4] == [(6, 8), (6, 8)]  # offsets and scales of anchors
    rates = PRESETS["paper"].rates
    assert rates.geometry == rates.planes
    assert rates.deformation.at(1) == rates.deformation.at(0) == 1.6e-4
    assert "deformation" not in random_model().parameter_groups(canonical=True)


def test_a_new_anchor_has_gates_of_its_own_and_the_interval_counts_views() -> None:
    model = blank_model(config(), 3)
    with torch.no_grad():
        model.anchors.position.copy_(torch.arange(9.0).view(3, 3))
        assert model.anchors.dynamics is not None
        model.anchors.dynamics.fill_(3)
        model.anchors.offset.fill_(0.4)
    settings = replace(PRESETS["paper"], views_per_step=2)

    def after(views: float) -> Any:
        statistics = Statistics.zeros(3, 2)
        statistics.gradient += 100 * views
        statistics.drawn += views
        generator = torch.Generator().manual_seed(0)
        return METHOD.edit(model, statistics, settings, 0.01, generator)

    edit = after(80)  # more than half of 70 % of an interval's 200 views
    assert len(edit.parent)
    assert torch.equal(edit.values["anchors.dynamics"], torch.zeros(len(edit.parent), 2))
    assert not len(after(60).parent)


def test_an_anchor_goes_where_both_deformations_take_its_place() -> None:
    model = random_model()
    with torch.no_grad():
        for parameter in (model.anchors.offset, model.decoder.opacity.output.weight):
            parameter.zero_()  # the first Gaussian is its anchor's own place
        model.gad.head_offset.output.weight.zero_()
        model.gad.head_offset.output.bias.zero_()
        centers, means = model.centers(0.3), model.gaussians(0.3, camera()).means[::2]
    assert torch.allclose(centers, means)
    assert torch.equal(model.centers(None), model.anchors.position)
