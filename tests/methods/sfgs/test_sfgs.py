"""4D-SFGS's Gaussians, weights and growth against their formulas, written out in loops."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from aa4d.anchors.densification import Statistics
from aa4d.methods.contract import Beginning
from aa4d.methods.rendering import Rendered
from aa4d.methods.sfgs.decoding import AnchorRows4D
from aa4d.methods.sfgs.growth import grow_and_prune
from aa4d.methods.sfgs.method import METHOD
from aa4d.methods.sfgs.model import Sfgs, blank_model
from aa4d.methods.sfgs.settings import PRESETS, Growth, ModelConfig
from aa4d.raster.types import Camera
from tests.methods.formulas import sigmoid, two_layer

EYE = [0.3, -0.2, -4.0]
CONFIG = ModelConfig(offsets=2, feature_dim=3, decoder_hidden=5, fastest=0.7)
CLIP_S = 2.5


def random_model(n: int = 5, config: ModelConfig = CONFIG) -> Sfgs:
    torch.manual_seed(0)
    model = blank_model(config, n).double()
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.normal_(0, 0.5)
        model.anchors.position.normal_(0, 1)
        model.anchors.position[:, 3].abs_()
        model.decoder.opacity.output.bias.copy_(torch.tensor([1.5, -1.5]))  # the second is not drawn
        model.decoder.opacity.output.weight.mul_(0.2)
    model.clip_s.fill_(CLIP_S)
    model.frame_s.fill_(0.25)
    return model


def camera() -> Camera:
    viewmat = torch.eye(4, dtype=torch.float64)
    viewmat[:3, 3] = -torch.tensor(EYE, dtype=torch.float64)
    return Camera(viewmat, torch.eye(3, dtype=torch.float64), 8, 8)


def slowly(model: Sfgs, t: float | None) -> list[dict[str, list[float]]]:
    c, decoder, result = model.config, model.decoder, []
    rows = AnchorRows4D(**{name: value.detach() for name, value in vars(model.anchors.rows()).items()})
    for n in range(len(model)):
        feature, place = rows.feature[n].tolist(), rows.position[n].tolist()
        scale = rows.log_scale[n].exp().tolist()
        toward = [a - b for a, b in zip(place[:3], EYE, strict=True)]
        color = two_layer(decoder.color, feature + [v / math.hypot(*toward) for v in toward])
        opacity, covariance, velocity = (
            two_layer(network, feature) for network in (decoder.opacity, decoder.covariance, decoder.velocity)
        )
        for k in range(c.offsets):
            x, y, z, moment = (place[i] + float(rows.offset[n, k, i]) * scale[i] for i in range(4))
            own = covariance[8 * k : 8 * k + 8]
            rate = 1 + (own[3] if own[3] > 0 else math.exp(own[3]) - 1)
            means, fade = [x, y, z], 1.0
            if t is not None:
                ahead = moment - t * CLIP_S
                speeds = [c.fastest * math.tanh(v) for v in velocity[3 * k : 3 * k + 3]]
                means = [m + v * ahead for m, v in zip(means, speeds, strict=True)]
                fade = math.exp(-(abs(ahead * rate) ** c.beta))
            lasting = max(math.tanh(opacity[k]), 0)
            result.append(
                {
                    "means": means,
                    "scales": [scale[4 + i] * sigmoid(own[i]) for i in range(3)],
                    "quaternions": own[4:],
                    "opacities": [lasting * fade],
                    "colors": [sigmoid(v) for v in color[3 * k : 3 * k + 3]],
                    "lasting": [lasting],
                    "fade": [fade],
                    "rate": [rate],
                }
            )
    return result


@pytest.mark.parametrize("t", [None, 0.0, 0.37, 1.0])
@pytest.mark.parametrize("beta", [4.0, 2.0])
def test_gaussians_agree_with_the_formulas_number_by_number(t: float | None, beta: float) -> None:
    model = random_model(config=replace(CONFIG, beta=beta))
    with torch.no_grad():
        got = model.gaussians(t, camera())
    for row, expected in enumerate(slowly(model, t)):
        for name, values in expected.items():
            assert getattr(got, name)[row].flatten().tolist() == pytest.approx(values, rel=1e-9, abs=1e-12), name
    if t is not None:
        assert got.fade.min() < 0.5 < got.fade.max()


def test_gradients_are_those_of_finite_differences() -> None:
    model = random_model(n=3)

    def drawn(*_: torch.Tensor) -> tuple[torch.Tensor, ...]:
        g = model.gaussians(0.4, camera())
        return g.means, g.scales, g.quaternions, g.opacities[::2], g.colors

    assert torch.autograd.gradcheck(drawn, tuple(model.parameters()), fast_mode=True)


def test_an_anchor_moves_as_its_gaussians_in_the_mean() -> None:
    model = random_model()
    with torch.no_grad():
        where = [model.gaussians(t, camera()).means.view(len(model), 2, 3).mean(1) for t in (0.2, 0.9)]
        assert torch.allclose(model.centers(0.9) - model.centers(0.2), where[1] - where[0])
        assert torch.equal(model.centers(None), model.anchors.position[:, :3])


def test_far_from_its_moment_nothing_is_left_and_every_gradient_is_finite() -> None:
    model = random_model()
    with torch.no_grad():
        model.anchors.position[:, 3] = 1e12
    gaussians = model.gaussians(0.5, camera())
    gaussians.opacities.sum().backward()
    assert gaussians.opacities.max() < 1e-12
    assert all(torch.isfinite(p.grad).all() for p in model.parameters() if p.grad is not None)


def test_statistics_weigh_a_gaussian_by_what_is_left_of_it_and_by_how_fast_it_fades() -> None:
    model, visible = random_model(), torch.tensor([0, 2, 3])
    gaussians = model.gaussians(0.37, camera(), visible)
    radii, gradient = torch.tensor([2, 0, 3, 1, 1, 0]), torch.arange(1.0, 7.0)
    rendering = SimpleNamespace(radii=radii, screen_gradient=gradient)
    settings = replace(PRESETS["paper"], densification=Growth(gamma=1.5))
    statistics = Statistics.zeros(len(model), 2)
    METHOD.observe(statistics, Rendered(rendering, gaussians, visible), 2, settings)
    looks = slowly(model, 0.37)
    for i, anchor in enumerate(visible.tolist()):
        both = [looks[2 * anchor + k] for k in range(2)]
        assert float(statistics.opacity[anchor]) == pytest.approx(sum(look["lasting"][0] for look in both))
        for k, look in enumerate(both):
            weight = look["fade"][0] * look["rate"][0] ** 1.5 * (int(radii[2 * i + k]) > 0)
            assert float(statistics.drawn[anchor, k]) == pytest.approx(weight)
            assert float(statistics.gradient[anchor, k]) == pytest.approx(weight * 2 * float(gradient[2 * i + k]))
    assert statistics.seen.tolist() == [1, 0, 1, 1, 0]


def slow_growth(model: Sfgs, statistics: Statistics, d: Growth, voxel: float, seed: int) -> list[tuple[Any, ...]]:
    """(cell's centre, parent) of each new anchor, in order."""
    generator = torch.Generator().manual_seed(seed)
    cell_s, rows = d.cell_frames * float(model.frame_s), model.anchors.rows()
    centres = rows.moments().tolist()
    grown: list[tuple[Any, ...]] = []
    places = rows.position.tolist()
    for level in range(d.levels):
        size = [voxel * max(d.voxel_factor / 4**level, 1)] * 3 + [cell_s]
        kept = torch.rand(statistics.gradient.shape, generator=generator) < 1 - 0.5 ** (level + 1)
        taken = {tuple(round(p / s) for p, s in zip(place, size, strict=True)) for place in places}
        candidates = []
        for n in range(len(model)):
            for k in range(model.per_unit):
                weight = float(statistics.drawn[n, k])
                mean = float(statistics.gradient[n, k]) / max(weight, 1)
                often = weight > 0.5 * d.interval * d.seen_share
                if mean >= d.gradient_threshold * 2**level and often and kept[n, k]:
                    candidates.append((-mean, n, k))
        for _, n, k in sorted(candidates):
            cell = tuple(round(p / s) for p, s in zip(centres[n][k], size, strict=True))
            if cell not in taken:
                taken.add(cell)
                center = [c * s for c, s in zip(cell, size, strict=True)]
                grown.append((center, n, size[0]))
                places.append(center)
    return grown


def test_growth_agrees_with_the_rule_anchor_by_anchor() -> None:
    model = random_model(n=40)
    generator = torch.Generator().manual_seed(5)
    statistics = Statistics.zeros(40, 2)
    statistics.drawn += 80 * torch.rand(40, 2, generator=generator)  # some too rarely
    statistics.gradient += statistics.drawn * 1e-3 * torch.rand(40, 2, generator=generator)
    d = Growth(levels=3, voxel_factor=16, cell_frames=2.0)
    expected = slow_growth(model, Statistics(*(v.clone() for v in vars(statistics).values())), d, 0.05, seed=3)
    edit = grow_and_prune(model, statistics, d, 0.05, torch.Generator().manual_seed(3))
    assert len(expected) > 15
    assert edit.parent.tolist() == [parent for _, parent, _ in expected]
    assert torch.allclose(
        edit.values["anchors.position"], torch.tensor([center for center, _, _ in expected], dtype=torch.float64)
    )
    edges = [[edge] * 3 + [0.5] + [min(edge, math.exp(0.05))] * 3 for *_, edge in expected]
    assert torch.allclose(edit.values["anchors.log_scale"].exp(), torch.tensor(edges, dtype=torch.float64))
    assert edit.values["anchors.offset"].count_nonzero() == 0


def test_the_same_place_at_another_time_is_empty() -> None:
    model = random_model(n=1)
    with torch.no_grad():
        model.anchors.offset.zero_()
        model.anchors.log_scale.zero_()
        model.anchors.offset[0, :, 3] = 1.0  # a second later: four voxels
    for seconds, grown in ((1.0, 1), (0.01, 0)):
        statistics = Statistics.zeros(1, 2)
        statistics.gradient += 100
        statistics.drawn += 90
        with torch.no_grad():
            model.anchors.offset[0, :, 3] = seconds
        model.anchors.position[:, 3] = 0.25
        edit = grow_and_prune(model, statistics, Growth(levels=1), 0.05, torch.Generator().manual_seed(0))
        assert len(edit.parent) == grown


def test_anchors_begin_all_over_the_clip() -> None:
    points = np.random.default_rng(0).uniform(-1, 1, (200, 3))
    beginning = Beginning(points, np.zeros((200, 3), np.uint8), frames=9, seconds=4.0, pixel=0.01)
    model = METHOD.initial(PRESETS["quick"], beginning)
    moments = model.anchors.position[:, 3]
    assert 0 <= moments.min() < 0.4
    assert 3.6 < moments.max() <= 4
    assert float(model.frame_s) == pytest.approx(0.5)
