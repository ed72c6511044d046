"""Growing, pruning and what new anchors inherit."""

import math

import numpy as np
import pytest
import torch

from aa4d.anchors.canonical import EMBEDDINGS, Anchors, spacing, voxel_centres
from aa4d.anchors.densification import Growth, Statistics, grow
from aa4d.methods.adaanchor4d.model import AdaAnchor4D
from aa4d.methods.adaanchor4d.settings import LearningRates, ModelConfig
from aa4d.methods.anchor_growth import edit_of
from aa4d.training.checkpoints import TrainingState
from aa4d.training.optimiser import edit_units, make_optimiser
from aa4d.training.spent import Spent

CONFIG = ModelConfig(offsets=4, spatial_resolutions=(4,), temporal_resolution=4)


def grow_from(position: torch.Tensor, centres: torch.Tensor, gradient: torch.Tensor, **options: float) -> Growth:
    statistics = Statistics.zeros(*gradient.shape)
    statistics.gradient += gradient * 100
    statistics.drawn += 100
    settings = {"voxel": 0.1, "voxel_factor": 1, "levels": 1, "gradient_threshold": 1.0, "min_drawn": 40.0, "limit": 99}
    settings |= options
    return grow(position, centres, statistics, generator=torch.Generator().manual_seed(0), **settings)


def test_grows_one_anchor_in_each_empty_voxel_from_its_strongest_candidate() -> None:
    position = torch.zeros(3, 3)
    position[1:, 0] = torch.tensor([5.0, 9.0])
    # Forty candidates of anchors 1 and 2 in one far voxel: about half survive the random choice.
    centres = torch.full((3, 40, 3), 2.0)
    gradient = torch.zeros(3, 40)
    gradient[1], gradient[2] = 2.0, 3.0
    growth = grow_from(position, centres, gradient)
    assert growth.position.tolist() == [[2.0, 2.0, 2.0]]
    assert growth.parent.tolist() == [2]
    assert growth.voxel.tolist() == [pytest.approx(0.1)]


def test_occupied_voxels_and_weak_or_rarely_drawn_gaussians_grow_nothing() -> None:
    position, centres = torch.zeros(1, 3), torch.full((1, 40, 3), 0.01)
    assert len(grow_from(position, centres, torch.full((1, 40), 2.0)).parent) == 0
    far = torch.full((1, 40, 3), 2.0)
    assert len(grow_from(position, far, torch.full((1, 40), 0.5)).parent) == 0
    assert len(grow_from(position, far, torch.full((1, 40), 2.0), min_drawn=100.0).parent) == 0


def test_limit_bounds_the_number_of_new_anchors_over_all_levels() -> None:
    centres = torch.rand(1, 400, 3, generator=torch.Generator().manual_seed(3)) * 10 + 1
    gradient = torch.full((1, 400), 100.0)
    assert len(grow_from(torch.zeros(1, 3), centres, gradient, levels=3, voxel_factor=16, limit=7).parent) == 7


def state_with_moments(n: int) -> TrainingState:
    torch.manual_seed(0)
    anchors = Anchors(torch.randn(n, 3), torch.zeros(n, 6), 4, 32, 32)
    torch.nn.init.normal_(anchors.feature)
    model = AdaAnchor4D(CONFIG, anchors)
    optimiser = make_optimiser(model, LearningRates(), canonical=False)
    sum(p.square().sum() for p in model.parameters()).backward()
    optimiser.step()
    return TrainingState("fine", 1, Spent(), model, optimiser, Statistics.zeros(n, 4))


def test_new_anchors_inherit_from_their_parents_and_moments_follow_their_rows() -> None:
    state = state_with_moments(5)
    before = {k: v.clone() for k, v in state.model.anchors.state_dict().items()}
    before["log_scale"][1:, 3:] = 7.0
    state.model.anchors.log_scale.data[1:, 3:] = 7.0
    owned = ("feature", "offset", "log_scale", *EMBEDDINGS)
    moments = {
        (k, moment): state.optimiser.state[getattr(state.model.anchors, k)][moment].clone()
        for k in owned
        for moment in ("exp_avg", "exp_avg_sq")
    }
    shared = {p: dict(s) for p, s in state.optimiser.state.items() if len(p) != 5}
    keep = torch.tensor([True, False, True, True, True])
    growth = Growth(torch.ones(2, 3), torch.tensor([0.1, 0.4]), torch.tensor([4, 0]))
    state.statistics = edit_units(
        state.model, state.optimiser, state.statistics, edit_of(state.model.anchors, keep, growth)
    )
    after = state.model.anchors
    assert len(after) == 6
    for name in ("feature", *EMBEDDINGS):
        assert torch.equal(getattr(after, name)[:4], before[name][keep])
        assert torch.equal(getattr(after, name)[4:], before[name][[4, 0]])
    assert torch.count_nonzero(after.offset[4:]) == 0
    assert after.log_scale[4:, 0].tolist() == pytest.approx([math.log(0.1), math.log(0.4)])
    assert torch.equal(after.log_scale[:4, :3], before["log_scale"][keep][:, :3])
    assert after.log_scale[:4, 3:].max().item() == pytest.approx(0.05)
    for (name, moment), expected in moments.items():
        now = state.optimiser.state[getattr(after, name)][moment]
        assert torch.equal(now[:4], expected[keep])
        assert torch.count_nonzero(now[4:]) == 0
        assert state.optimiser.state[getattr(after, name)]["step"].item() == 1
    for parameter, kept_state in shared.items():
        assert all(state.optimiser.state[parameter][key] is value for key, value in kept_state.items())
    in_groups = {id(p) for group in state.optimiser.param_groups for p in group["params"]}
    assert {id(p) for p in state.model.parameters()} == in_groups


def test_voxel_centres_are_unique_and_spacing_survives_duplicates() -> None:
    points = np.array([[0.01, 0, 0], [0.02, 0, 0], [1.0, 0, 0]])
    assert voxel_centres(points, 0.1).shape == (2, 3)
    assert (spacing(np.zeros((5, 3)), floor=1e-3) == 1e-3).all()
    assert spacing(np.zeros((1, 3)), floor=0.5).tolist() == [0.5]
    np.testing.assert_allclose(spacing(np.array([[0.0, 0, 0], [3.0, 0, 0]]), floor=0.1), 3.0)
