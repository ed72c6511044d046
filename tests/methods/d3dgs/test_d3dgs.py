"""D3DGS's deformation, time noise and schedule against their formulas, written out in loops."""

import math
from dataclasses import replace

import pytest
import torch
from torch import nn

from aa4d.anchors.densification import Statistics
from aa4d.field.encoding import encoded
from aa4d.methods.contract import Look
from aa4d.methods.d3dgs.method import METHOD
from aa4d.methods.d3dgs.model import D3DGS
from aa4d.methods.d3dgs.network import ROWS, DeformationNetwork
from aa4d.methods.d3dgs.settings import PRESETS, D3DGSSettings, ModelConfig
from aa4d.methods.gaussians.model import blank_rows
from aa4d.training.optimiser import edit_units, make_optimiser
from tests.methods.formulas import changed, linear, relu

CONFIG = ModelConfig(width=7, depth=4, skip=1, place_frequencies=3, time_frequencies=2)


def random_model(config: ModelConfig = CONFIG, n: int = 5) -> D3DGS:
    torch.manual_seed(0)
    model = D3DGS(config, blank_rows(n)).double()
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.normal_(0, 0.5)
    return model


def sines(x: list[float], frequencies: int) -> list[float]:
    values = list(x)
    for k in range(frequencies):
        values += [math.sin(2**k * v) for v in x] + [math.cos(2**k * v) for v in x]
    return values


def changes(network: DeformationNetwork, position: list[float], t: float) -> tuple[list[float], ...]:
    """Of position, quaternion and scale."""
    c = network.config
    given = sines(position, c.place_frequencies) + sines([t], c.time_frequencies)
    h = given
    for i, layer in enumerate(network.layers):
        assert isinstance(layer, nn.Linear)
        h = relu(linear(layer, h))
        if i == c.skip:
            h = given + h
    return tuple(linear(head, h) for head in (network.head_position, network.head_quaternion, network.head_scale))


def test_the_deformation_agrees_with_the_formulas_number_by_number() -> None:
    model, t = random_model(), 0.3
    rows = model.free.rows()
    with torch.no_grad():
        after = model.deformed(rows, t)
    for n in range(len(model)):
        shift, turn, growth = changes(model.network, rows.position[n].tolist(), t)
        quaternion = rows.quaternion[n].tolist()
        expected = {"position": [a + b for a, b in zip(rows.position[n].tolist(), shift, strict=True)]}
        expected |= changed(quaternion, rows.log_scale[n].tolist(), turn, growth)
        for name, values in expected.items():
            assert getattr(after, name)[n].tolist() == pytest.approx(values, rel=1e-9, abs=1e-9), name
    for name in ("opacity", "sh_constant", "sh_rest"):
        assert torch.equal(getattr(after, name), getattr(rows, name))


def test_gradients_are_those_of_finite_differences() -> None:
    model = random_model(n=2)

    def moved(*_: torch.Tensor) -> tuple[torch.Tensor, ...]:
        after = model.deformed(model.free.rows(), 0.4)
        return after.position, after.log_scale, after.quaternion

    assert torch.autograd.gradcheck(moved, (model.free.log_scale, model.free.quaternion, *model.network.parameters()))


def test_a_place_learns_where_it_is_and_nothing_through_the_network() -> None:
    model = random_model()
    after = model.deformed(model.free.rows(), 0.4)
    (after.position.sum() + after.log_scale.sum() + after.quaternion.sum()).backward()
    assert torch.equal(model.free.position.grad, torch.ones(5, 3, dtype=torch.float64))


def test_rows_go_through_the_network_one_by_one() -> None:
    network = DeformationNetwork(replace(CONFIG, width=16)).double()
    position = torch.randn(ROWS + 3, 3, dtype=torch.float64)
    whole = torch.cat(network(position, 0.7), dim=1)
    few = torch.cat(network(position[ROWS - 2 :], 0.7), dim=1)
    assert torch.allclose(whole[ROWS - 2 :], few, rtol=1e-12, atol=1e-14)
    assert [len(part) for part in network(position[:0], 0.7)] == [0, 0, 0]


def test_the_published_network_has_its_published_size() -> None:
    network = DeformationNetwork(ModelConfig())
    assert sum(p.numel() for p in network.parameters()) == 506_378
    assert encoded(torch.zeros(1, 3), 10).shape == (1, 63)


def test_a_still_start_changes_nothing_but_the_quaternions_length() -> None:
    model = random_model(replace(CONFIG, still_start=True))
    with torch.no_grad():
        for head in (model.network.head_position, model.network.head_quaternion, model.network.head_scale):
            head.weight.zero_()
            head.bias.zero_()
        after, rows = model.deformed(model.free.rows(), 0.4), model.free.rows()
    assert torch.equal(after.position, rows.position)
    assert torch.allclose(after.log_scale, rows.log_scale)
    assert torch.allclose(after.quaternion, torch.nn.functional.normalize(rows.quaternion, dim=1))


def settings_of(**changes: object) -> D3DGSSettings:
    base = replace(PRESETS["main"], coarse_iterations=100, fine_iterations=300)
    growth = replace(base.densification, start=10, interval=10, until=200, reset_every=50)
    return replace(base, densification=growth, **changes)


def test_time_noise_falls_linearly_over_half_the_run() -> None:
    settings = settings_of()
    coarse, fine = METHOD.stages(settings)
    views, draws = 40, 4000
    assert METHOD.trained_time(coarse, 5, 0.5, views, settings) == 0.5
    for iteration in (0, 50, 99):
        times = torch.tensor(
            [METHOD.trained_time(fine, iteration, 0.5, views, replace(settings, seed=seed)) for seed in range(draws)]
        )
        deviation = 0.1 * (1 - (100 + iteration) / 200) / views
        assert abs(float(times.mean()) - 0.5) < 4 * deviation / math.sqrt(draws)
        assert float(times.std()) == pytest.approx(deviation, rel=0.05)
    assert METHOD.trained_time(fine, 100, 0.5, views, settings) == 0.5
    first = METHOD.trained_time(fine, 3, 0.5, views, settings)
    assert (
        first
        == METHOD.trained_time(fine, 3, 0.5, views, settings)
        != METHOD.trained_time(fine, 4, 0.5, views, settings)
    )


def test_rates_fall_over_the_warm_up_and_the_rest_as_over_one_run() -> None:
    coarse, fine = METHOD.stages(settings_of())
    assert (coarse.progress(0), fine.progress(299)) == (0.0, 1.0)
    assert coarse.progress(99) == fine.progress(0) == 0.25


def no_looks() -> list[Look]:
    raise AssertionError("D3DGS looks at no picture here")


def test_opacity_is_reset_after_every_period_of_the_run_while_growth_lasts() -> None:
    settings, model = settings_of(), random_model()
    coarse, fine = METHOD.stages(settings)
    resets = []
    for stage, offset in ((coarse, 0), (fine, 100)):
        for done in range(1, stage.iterations + 1):
            edit = METHOD.revise(stage, done, model, settings, no_looks)
            if edit is not None and edit.anew:
                resets.append(offset + done)
    assert resets == [51, 101, 151, 201, 251]


def test_a_reset_lowers_opacities_and_begins_their_moments_anew() -> None:
    settings, model = settings_of(), random_model()
    with torch.no_grad():
        model.free.opacity.copy_(torch.tensor([-9.0, -2, 0, 3, 9]))
    optimiser = make_optimiser(model, settings.rates, canonical=False)
    sum(p.square().sum() for p in model.parameters()).backward()
    optimiser.step()
    before = {name: model.tensor(name).detach().clone() for name in model.unit_tensors()}
    edit = METHOD.revise(METHOD.stages(settings)[0], 51, model, settings, no_looks)
    assert edit is not None
    edit_units(model, optimiser, Statistics.zeros(5, 1), edit)
    opacity = model.free.opacity.detach().sigmoid()
    assert torch.allclose(opacity, before["free.opacity"].sigmoid().clamp_max(0.01))
    assert optimiser.state[model.free.opacity]["exp_avg"].count_nonzero() == 0
    assert optimiser.state[model.free.position]["exp_avg"].count_nonzero() > 0
    for name in set(before) - {"free.opacity"}:
        assert torch.equal(model.tensor(name), before[name]), name


def test_large_ones_go_once_opacities_were_reset_and_transparent_ones_always() -> None:
    settings, model = settings_of(), random_model()
    with torch.no_grad():
        model.free.log_scale.fill_(math.log(0.05))
        model.free.log_scale[1, 2] = math.log(0.2)
        model.free.opacity.fill_(0.0)
        model.free.opacity[3] = -6.0  # 0.0025
    coarse = METHOD.stages(settings)[0]
    early = METHOD.revise(coarse, 40, model, settings, no_looks)
    late = METHOD.revise(coarse, 60, model, settings, no_looks)
    assert early is not None
    assert early.keep.tolist() == [0, 1, 2, 4]
    assert late is not None
    assert late.keep.tolist() == [0, 2, 4]
    assert METHOD.revise(coarse, 45, model, settings, no_looks) is None


def test_growth_goes_by_the_absolute_gradient_where_the_preset_says_so() -> None:
    assert METHOD.outputs(PRESETS["main"]) == ("absolute_gradient",)
    assert METHOD.outputs(PRESETS["paper"]) == ()
    assert PRESETS["paper"].densification.gradient_threshold == 2e-4
    assert PRESETS["main"].densification.gradient_threshold == 7e-4
