"""SD-GS's deformation against its formulas, in loops; whose gradients count; where the fine stage begins."""

import math
from dataclasses import replace
from typing import Any

import pytest
import torch

from aa4d.anchors.densification import Statistics
from aa4d.methods.contract import Stage
from aa4d.methods.rendering import Rendered
from aa4d.methods.sdgs.method import METHOD, weight_of
from aa4d.methods.sdgs.model import DeformedGaussians, Sdgs, blank_model
from aa4d.methods.sdgs.settings import PRESETS, Growth, ModelConfig
from aa4d.raster.types import Camera, Rendering
from tests.methods.formulas import linear, product_of_planes, relu, sigmoid, two_layer

EYE = [0.3, -0.2, -4.0]
SMALL = ModelConfig(
    offsets=2, feature_dim=3, decoder_hidden=5, time_frequencies=2, plane_dim=3, spatial_resolutions=(4, 6),
    temporal_resolution=5, width=8,
)  # fmt: skip


def random_model(n: int = 6, config: ModelConfig = SMALL) -> Sdgs:
    torch.manual_seed(1)
    model = blank_model(config, n).double()
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.normal_(0, 0.6)
        model.anchors.position.normal_(0, 0.7)
        model.decoder.opacity.output.weight.mul_(0.1)
        model.decoder.opacity.output.bias.copy_(torch.tensor([1.0, -1.0]))  # the second Gaussian is not drawn
        model.deformation.field.box.copy_(torch.tensor([[-1.0, -2, -3], [2, 1, 0.5]]))
    return model


def camera() -> Camera:
    viewmat = torch.eye(4, dtype=torch.float64)
    viewmat[:3, 3] = -torch.tensor(EYE, dtype=torch.float64)
    return Camera(viewmat, torch.eye(3, dtype=torch.float64), 8, 8)


def slowly(model: Sdgs, t: float | None) -> list[dict[str, Any]]:
    """What each Gaussian looks like at t, with the change of its anchor."""
    anchors, deformation, result = model.anchors, model.deformation, []
    octaves = range(model.config.time_frequencies)
    time = [0.0] * 5 if t is None else [t, *(f(2**k * t) for k in octaves for f in (math.sin, math.cos))]
    for n in range(len(model)):
        position, log_scale = anchors.position[n].tolist(), anchors.log_scale[n].tolist()
        offset = anchors.offset[n].flatten().tolist()
        shift, growth = [0.0] * 3, [0.0] * 6
        if t is not None:
            z = relu(linear(deformation.encoder, product_of_planes(deformation.field, position, t)))
            shift, growth = two_layer(deformation.head_position, z), two_layer(deformation.head_log_scale, z)
        position = [a + b for a, b in zip(position, shift, strict=True)]
        scale = [math.exp(a + b) for a, b in zip(log_scale, growth, strict=True)]
        toward = [a - b for a, b in zip(position, EYE, strict=True)]
        view = anchors.feature[n].tolist() + time + [v / math.hypot(*toward) for v in toward]
        opacity, color, covariance = (
            two_layer(network, view)
            for network in (model.decoder.opacity, model.decoder.color, model.decoder.covariance)
        )
        for k in range(model.config.offsets):
            shares = covariance[7 * k : 7 * k + 3]
            result.append(
                {
                    "means": [position[i] + offset[3 * k + i] * scale[i] for i in range(3)],
                    "scales": [scale[3 + i] * sigmoid(shares[i]) for i in range(3)],
                    "quaternions": covariance[7 * k + 3 : 7 * k + 7],
                    "opacities": [max(math.tanh(opacity[k]), 0.0)],
                    "colors": [sigmoid(v) for v in color[3 * k : 3 * k + 3]],
                    "change": (math.hypot(*shift), math.hypot(*growth)),
                }
            )
    return result


@pytest.mark.parametrize("t", [0.3, None])
def test_gaussians_agree_with_the_formulas_number_by_number(t: float | None) -> None:
    model = random_model()
    with torch.no_grad():
        got = model.gaussians(t, camera())
    drawn = 0
    for row, expected in enumerate(slowly(model, t)):
        moved, scaled = expected.pop("change")
        if t is not None:
            assert isinstance(got, DeformedGaussians)
            assert float(got.moved[row // 2]) == pytest.approx(moved, rel=1e-9)
            assert float(got.scaled[row // 2]) == pytest.approx(scaled, rel=1e-9)
        if expected["opacities"] == [0.0]:
            assert got.opacities[row] == 0
            continue
        drawn += 1
        for name, values in expected.items():
            assert getattr(got, name)[row].flatten().tolist() == pytest.approx(values, rel=1e-9, abs=1e-9), name
    assert drawn == len(model)


def test_gradients_are_those_of_finite_differences() -> None:
    tiny = replace(
        SMALL, feature_dim=2, decoder_hidden=2, time_frequencies=1, plane_dim=1, spatial_resolutions=(3,),
        temporal_resolution=3, width=2, learn_lookup=True,
    )  # fmt: skip
    model = random_model(2, tiny)
    owned = [model.anchors.feature, model.anchors.offset, model.anchors.log_scale]

    def drawn(*_: torch.Tensor) -> tuple[torch.Tensor, ...]:
        g = model.gaussians(0.4, camera())
        alive = g.opacities > 0
        assert alive.sum() == len(model)
        return g.means[alive], g.scales[alive], g.quaternions[alive], g.opacities[alive], g.colors[alive]

    assert torch.autograd.gradcheck(drawn, (*owned, *model.deformation.parameters()), fast_mode=True)


def test_what_moves_most_counts_most_and_a_view_counts_as_one() -> None:
    """Eleven anchors: the 90th percentile of 0, 1, ..., 10 is 9; of scales, all alike, the same."""
    moved, scaled = torch.arange(11.0), torch.full((11,), 2.0)
    weight = weight_of(moved, scaled, Growth())
    expected = [0.8 * n / 9 + 0.1 for n in range(11)]
    mean = sum(expected) / 11
    assert weight.tolist() == pytest.approx([v / mean for v in expected], rel=1e-5)
    assert weight.mean().item() == pytest.approx(1)


@pytest.mark.parametrize("size", [0.0, 1e-40, 1e-30, 1e30])
def test_weights_are_finite_whatever_the_size_of_changes(size: float) -> None:
    change = torch.tensor([0.0, 1.0, 3.0]) * size
    weight = weight_of(change, change, Growth())
    assert torch.isfinite(weight).all()
    assert (weight >= 0).all()
    assert weight.mean().item() == pytest.approx(1) or weight.max() < 1e-6
    assert len(weight_of(torch.zeros(0), torch.zeros(0), Growth())) == 0
    if size == 0:
        assert weight.tolist() == [1, 1, 1]


def test_statistics_of_a_view_are_weighted_by_the_anchor() -> None:
    model = random_model().float()
    g = model.gaussians(0.3, Camera(camera().viewmat.float(), torch.eye(3), 8, 8))
    assert isinstance(g, DeformedGaussians)
    n, image = len(g.means), torch.zeros(8, 8, 3)
    rendering = Rendering(image, image[..., 0], None, torch.ones(n, dtype=torch.int32), torch.full((n,), 0.5))
    statistics = Statistics.zeros(len(model), 2)
    METHOD.observe(statistics, Rendered(rendering, g, torch.arange(len(model))), 1, PRESETS["quick"])
    weight = weight_of(g.moved, g.scaled, PRESETS["quick"].densification)
    assert torch.allclose(statistics.drawn, weight[:, None].expand(-1, 2))
    assert torch.allclose(statistics.gradient, 0.5 * weight[:, None].expand(-1, 2))
    assert torch.equal(statistics.seen, torch.ones(len(model))), "pruning asks how often an anchor was in view"


def test_the_fine_stage_begins_where_the_static_one_ended() -> None:
    config = replace(SMALL, still_start=True)
    torch.manual_seed(2)
    model = Sdgs(config, torch.randn(5, 3), torch.zeros(5, 6))
    METHOD.enter(Stage("fine", 1, 1), model, PRESETS["quick"])
    eye = Camera(camera().viewmat.float(), torch.eye(3), 8, 8)
    with torch.no_grad():
        static, moving = model.gaussians(None, eye), model.gaussians(0.7, eye)
    for name in ("means", "scales", "quaternions", "opacities", "colors"):
        assert torch.equal(getattr(static, name), getattr(moving, name)), name


def test_every_parameter_learns_in_one_group() -> None:
    model = random_model()
    grouped = [id(p) for parameters in model.parameter_groups(canonical=False).values() for p in parameters]
    assert sorted(grouped) == sorted(id(p) for p in model.parameters() if p is not model.anchors.position)
