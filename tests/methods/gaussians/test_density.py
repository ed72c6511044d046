import math
from dataclasses import replace

import torch
from scipy.spatial.transform import Rotation

from aa4d.anchors.densification import Statistics
from aa4d.methods.fourdgs.model import FourDGS, blank_model
from aa4d.methods.fourdgs.settings import ModelConfig, Rates
from aa4d.methods.gaussians.density import CloneAndSplit, clone_and_split, rotated
from aa4d.training.optimiser import edit_units, make_optimiser

SETTINGS = CloneAndSplit(gradient_threshold=1.0, largest_clone=0.1)


def model_of(scales: list[float], opacities: list[float]) -> FourDGS:
    torch.manual_seed(0)
    model = blank_model(ModelConfig(spatial_resolutions=(4,), temporal_resolution=4), len(scales))
    with torch.no_grad():
        model.free.position.copy_(torch.arange(3.0 * len(scales)).view(-1, 3))
        model.free.log_scale.copy_(torch.tensor(scales).log()[:, None].repeat(1, 3))
        model.free.quaternion.normal_()
        model.free.opacity.copy_(torch.logit(torch.tensor(opacities)))
        model.free.sh_constant.normal_()
    return model


def statistics_of(gradients: list[float]) -> Statistics:
    statistics = Statistics.zeros(len(gradients), 1)
    statistics.gradient[:, 0] = 2 * torch.tensor(gradients)
    statistics.drawn += 2
    return statistics


def seeded() -> torch.Generator:
    return torch.Generator().manual_seed(1)


def test_small_ones_are_cloned_large_ones_split_and_the_rest_stays() -> None:
    model = model_of([0.05, 0.5, 0.05], [0.5, 0.5, 0.5])
    statistics = statistics_of([2.0, 2.0, 0.5])
    edit = clone_and_split(model, statistics, SETTINGS, seeded())
    assert edit.keep.tolist() == [0, 2]
    assert edit.parent.tolist() == [0, 1, 1]
    assert torch.equal(edit.values["free.position"][0], model.free.position[0])
    assert (edit.values["free.position"][1:] - model.free.position[1]).norm(dim=1).min() > 0
    assert torch.allclose(edit.values["free.log_scale"][1:].exp(), torch.full((2, 3), 0.5 / 1.6))
    assert all(value.count_nonzero() == 0 for value in vars(statistics).values())


def test_children_inherit_everything_else_and_begin_without_moments() -> None:
    model = model_of([0.05, 0.5, 0.05], [0.6, 0.6, 0.6])
    optimiser = make_optimiser(model, Rates(), canonical=False)
    sum(p.square().sum() for p in model.parameters()).backward()
    optimiser.step()
    before = {name: model.tensor(name).detach().clone() for name in model.unit_tensors()}
    edit = clone_and_split(model, statistics_of([2.0, 2.0, 0.0]), SETTINGS, seeded())
    statistics = edit_units(model, optimiser, Statistics.zeros(3, 1), edit)
    assert len(model) == len(statistics.seen) == 5
    for name in ("free.quaternion", "free.opacity", "free.sh_constant", "free.sh_rest"):
        assert torch.equal(model.tensor(name), before[name][[0, 2, 0, 1, 1]]), name
    moments = optimiser.state[model.free.opacity]["exp_avg"]
    assert moments[:2].count_nonzero() == 2
    assert moments[2:].count_nonzero() == 0


def test_transparent_ones_go_once_there_are_too_many() -> None:
    model, statistics = model_of([0.05] * 3, [0.5, 0.001, 0.001]), statistics_of([0.0, 2.0, 0.0])
    assert clone_and_split(model, statistics, SETTINGS, seeded()).keep.tolist() == [0]
    patient = replace(SETTINGS, prune_above=3)
    edit = clone_and_split(model, statistics_of([0.0, 2.0, 0.0]), patient, seeded())
    assert (edit.keep.tolist(), edit.parent.tolist()) == ([0, 1, 2], [1])


def test_the_bound_is_kept_by_the_strongest() -> None:
    model = model_of([0.05] * 4, [0.5] * 4)
    bounded = replace(SETTINGS, max_gaussians=6)
    edit = clone_and_split(model, statistics_of([2.0, 5.0, 3.0, 4.0]), bounded, seeded())
    assert sorted(edit.parent.tolist()) == [1, 3]
    full = clone_and_split(model, statistics_of([2.0] * 4), replace(SETTINGS, max_gaussians=3), seeded())
    assert full.parent.tolist() == []


def test_halves_are_drawn_from_the_gaussian_itself() -> None:
    model = model_of([0.5], [0.5])
    with torch.no_grad():
        model.free.log_scale.copy_(torch.tensor([[0.4, 0.2, 1e-6]]).log())
    places = []
    for seed in range(300):
        generator = torch.Generator().manual_seed(seed)
        edit = clone_and_split(model, statistics_of([2.0]), SETTINGS, generator)
        places.append(edit.values["free.position"] - model.free.position.detach())
    q = model.free.quaternion.detach()[0].double().numpy()
    own = torch.cat(places).double().numpy() @ Rotation.from_quat(q[[1, 2, 3, 0]]).as_matrix()
    assert math.isclose(own[:, 0].std(), 0.4, rel_tol=0.1)
    assert math.isclose(own[:, 1].std(), 0.2, rel_tol=0.1)
    assert abs(own[:, 2]).max() < 1e-4


def test_rotations_are_those_of_scipy() -> None:
    torch.manual_seed(0)
    q, x = 3 * torch.randn(5, 4, dtype=torch.float64), torch.randn(5, 3, dtype=torch.float64)
    expected = Rotation.from_quat(q.numpy()[:, [1, 2, 3, 0]]).apply(x.numpy())
    assert torch.allclose(rotated(q, x), torch.from_numpy(expected))
