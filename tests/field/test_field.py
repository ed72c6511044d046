"""Planes, ACFA and DLGD against slow float64 transcriptions of the paper's equations."""

from collections.abc import Callable

import numpy as np
import pytest
import torch

from aa4d.field.planes import FeaturePlanes, regularisation
from aa4d.kernels.plane_lookup import AXES, PLANES, interpolate, look_up
from aa4d.kernels.plane_penalty import plane_penalty
from aa4d.methods.adaanchor4d.aggregation import Aggregation, Predicted, Weighted, make_aggregation
from aa4d.methods.adaanchor4d.aggregations import AGGREGATIONS
from aa4d.methods.adaanchor4d.geometry import OffsetDeformation, ScaleDeformation


@pytest.fixture
def field() -> FeaturePlanes:
    torch.manual_seed(0)
    field = FeaturePlanes(3, (4, 8), 5).double()
    with torch.no_grad():
        for parameter in field.parameters():
            parameter.uniform_(-1, 1)
    return field


def bilinear(plane: np.ndarray, x: float, y: float) -> np.ndarray:
    """One query, texel by texel: plane [R2, R1, C], x along R1."""
    column, row = ((c + 1) / 2 * (n - 1) for c, n in ((x, plane.shape[1]), (y, plane.shape[0])))
    c0, r0 = min(int(column), plane.shape[1] - 2), min(int(row), plane.shape[0] - 2)
    a, b = column - c0, row - r0
    top = (1 - a) * plane[r0, c0] + a * plane[r0, c0 + 1]
    return (1 - b) * top + b * ((1 - a) * plane[r0 + 1, c0] + a * plane[r0 + 1, c0 + 1])


def plane_features(field: FeaturePlanes, u: torch.Tensor, t: float) -> torch.Tensor:
    """g_p^(l) [L, N, 6, C]: what a sum with all its weight on one plane returns."""
    features = []
    for p in range(6):
        scores = u.new_full((len(u), 6, field.channels), -torch.inf)
        scores[:, p] = 0
        features.append(look_up(field.in_order(), u, t, scores).unflatten(1, (field.levels, -1)))
    return torch.stack(features, dim=2).transpose(0, 1)


@pytest.mark.parametrize("t", [0.0, 0.37, 1.0])
def test_planes_agree_with_a_loop_over_texels(field: FeaturePlanes, t: float) -> None:
    u = torch.rand(7, 3, dtype=torch.float64) * 2 - 1
    features = plane_features(field, u, t).detach().numpy()
    assert features.shape == (2, 7, 6, 3)
    for level, planes in enumerate(field.by_level()):
        for n in range(7):
            query = [*u[n].tolist(), 2 * t - 1]
            for p, name in enumerate(PLANES):
                expected = bilinear(planes[name].detach().numpy(), query[AXES[name[0]]], query[AXES[name[1]]])
                np.testing.assert_allclose(features[level, n, p], expected, atol=1e-12)


def test_time_zero_and_one_reach_the_first_and_last_row(field: FeaturePlanes) -> None:
    u = torch.full((1, 3), -1.0, dtype=torch.float64)
    plane = field.by_level()[0]["xt"]
    assert torch.equal(plane_features(field, u, 0.0)[0, 0, 3], plane[0, 0])
    assert torch.equal(plane_features(field, u, 1.0)[0, 0, 3], plane[-1, 0])


def test_outside_the_box_the_border_holds(field: FeaturePlanes) -> None:
    plane = field.by_level()[0]["xy"]
    far = interpolate(plane, torch.tensor([[7.0, -9.0]], dtype=torch.float64))
    assert torch.equal(far[0], plane[0, -1])
    assert field.normalise(torch.tensor([[5.0, -5.0, 0.0]], dtype=torch.float64)).tolist() == [[1.0, -1.0, 0.0]]


def test_a_box_without_height_counts_as_one_unit_more_to_both_sides(field: FeaturePlanes) -> None:
    field.box[:, 2] = 0.5
    u = field.normalise(torch.tensor([[0.0, 0.0, 0.5], [0.0, 0.0, 0.75], [0.0, 0.0, -4.0]], dtype=torch.float64))
    assert u[:, 2].tolist() == [0.0, 0.25, -1.0]


def test_planes_start_constant_in_time() -> None:
    field = FeaturePlanes(4, (8,), 6)
    u = torch.rand(5, 3) * 2 - 1
    torch.testing.assert_close(plane_features(field, u, 0.0), plane_features(field, u, 0.8))
    assert regularisation(field, 0.0, 1.0, 1.0).item() == 0.0


def test_the_penalty_is_the_second_difference_along_rows_and_the_distance_from_one() -> None:
    rows = torch.tensor([0.0, 1.0, 4.0])[:, None, None].expand(3, 5, 2)
    assert plane_penalty([rows], [1.0], [0.0]).item() == pytest.approx(4.0)
    assert plane_penalty([rows[:2]], [1.0], [0.0]).item() == 0.0
    assert plane_penalty([rows], [0.0], [1.0]).item() == pytest.approx(4 / 3)


WEIGHTED = ("acfa", "anchor_only", "time_only")


def weighted(name: str, embedding_dim: int, hidden: int, channels: int) -> Predicted:
    """A strategy with weights whose output layer has left zero, float64."""
    aggregation = make_aggregation(name, embedding_dim, hidden, channels)
    assert isinstance(aggregation, Predicted)
    torch.nn.init.normal_(aggregation.predictor.output.weight)
    return aggregation.double()


@pytest.mark.parametrize("name", WEIGHTED)
def test_weights_start_at_one_sixth(name: str) -> None:
    aggregation = make_aggregation(name, 32, 256, 16)
    assert isinstance(aggregation, Weighted)
    weights = aggregation.weights(torch.randn(9, 32), 0.3)
    assert weights.shape == (9, 6, 16)
    assert torch.equal(weights, torch.full_like(weights, 1 / 6))


def queries(count: int) -> torch.Tensor:
    return torch.rand(count, 3, dtype=torch.float64) * 1.8 - 0.9


def test_acfa_agrees_with_the_paper_in_loops(field: FeaturePlanes) -> None:
    torch.manual_seed(1)
    acfa = weighted("acfa", 4, 8, 3)
    embedding, u, t = torch.randn(5, 4).double(), queries(5), 0.7
    features = plane_features(field, u, t)
    h = acfa(field, u, embedding, t).detach().numpy()
    w1, b1, w2, b2 = (p.detach().numpy() for p in acfa.predictor.parameters())
    for i in range(5):
        z = w2 @ np.maximum(w1 @ np.append(embedding[i].numpy(), t) + b1, 0) + b2
        expected = []
        for level in range(2):
            for c in range(3):
                scores = np.exp([z[p * 3 + c] for p in range(6)])
                weights = scores / scores.sum()
                expected.append(sum(weights[p] * features[level, i, p, c].item() for p in range(6)))
        np.testing.assert_allclose(h[i], expected, atol=1e-12)


@pytest.mark.parametrize("name", ["anchor_only", "time_only"])
def test_a_half_conditioned_strategy_ignores_the_other_half(name: str) -> None:
    torch.manual_seed(2)
    aggregation = weighted(name, 4, 8, 3)
    embedding = torch.randn(5, 4).double()
    over_time = torch.stack([aggregation.weights(embedding, t) for t in (0.1, 0.9)])
    over_anchors = over_time[0]
    assert torch.equal(over_time[0], over_time[1]) == (name == "anchor_only")
    assert torch.equal(over_anchors[0], over_anchors[1]) == (name == "time_only")


@pytest.mark.parametrize(("name", "rule"), [("mean", np.mean), ("product", np.prod)])
def test_mean_and_product_agree_with_loops(
    field: FeaturePlanes, name: str, rule: Callable[[np.ndarray], float]
) -> None:
    u = queries(5)
    features = plane_features(field, u, 0.3).detach().numpy()
    h = make_aggregation(name, 4, 8, 3)(field, u, torch.empty(5, 4, dtype=torch.float64), 0.3)
    for i, level, c in np.ndindex(5, 2, 3):
        assert h[i, level * 3 + c].item() == pytest.approx(rule(features[level, i, :, c]), rel=1e-12)


def test_every_weighted_strategy_starts_as_the_mean(field: FeaturePlanes) -> None:
    field, u, embedding = field.float(), queries(5).float(), torch.randn(5, 4)
    expected = make_aggregation("mean", 4, 8, 3)(field, u, embedding, 0.3)
    for name in WEIGHTED:
        torch.testing.assert_close(make_aggregation(name, 4, 8, 3)(field, u, embedding, 0.3), expected)


@pytest.mark.parametrize("name", AGGREGATIONS)
def test_field_gradients_agree_with_finite_differences(field: FeaturePlanes, name: str) -> None:
    torch.manual_seed(3)
    acfa: Aggregation = weighted(name, 4, 6, 3) if name in WEIGHTED else make_aggregation(name, 4, 6, 3)
    u = (torch.rand(3, 3, dtype=torch.float64) * 1.8 - 0.9).requires_grad_()
    embedding = torch.randn(3, 4, dtype=torch.float64, requires_grad=name in ("acfa", "anchor_only"))

    def run(u: torch.Tensor, embedding: torch.Tensor, *_: torch.Tensor) -> torch.Tensor:
        return acfa(field, u, embedding, 0.43)

    assert torch.autograd.gradcheck(run, (u, embedding, *field.parameters(), *acfa.parameters()), atol=1e-6)


def test_dlgd_starts_at_the_canonical_geometry() -> None:
    embedding = torch.randn(4, 32)
    assert torch.count_nonzero(OffsetDeformation(32, 128, 10)(embedding, 0.5)) == 0
    assert torch.count_nonzero(ScaleDeformation(32, 128)(embedding, 0.5)) == 0
    assert OffsetDeformation(32, 128, 10)(embedding, 0.5).shape == (4, 10, 3)
