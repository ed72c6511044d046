"""Groups and their motions against closed form and against slow transcriptions in float64."""

import math

import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from aa4d.methods.speede.group_flow import GroupFlow, evenly, farthest_points, find_groups, nearest_group
from aa4d.methods.speede.rotations import best_rotations, matrix_of, turn_of
from aa4d.methods.speede.settings import FlowSettings


def random_turns(count: int, most: float, seed: int = 0) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    axis = torch.nn.functional.normalize(torch.randn(count, 3, generator=generator, dtype=torch.float64), dim=1)
    return axis * (most * torch.rand(count, 1, generator=generator, dtype=torch.float64))


def test_rotation_vectors_are_those_of_scipy() -> None:
    turns = torch.cat([random_turns(20, 3.1), random_turns(5, 1e-5, seed=1), torch.zeros(1, 3, dtype=torch.float64)])
    matrices = matrix_of(turns)
    assert torch.allclose(matrices, torch.from_numpy(Rotation.from_rotvec(turns.numpy()).as_matrix()), atol=1e-13)
    assert torch.allclose(turn_of(matrices), turns, atol=1e-9)


def test_rotations_have_finite_gradients_at_rest_and_exact_ones_elsewhere() -> None:
    turns = random_turns(3, 2.0).requires_grad_()
    assert torch.autograd.gradcheck(matrix_of, (turns,))
    assert torch.autograd.gradcheck(lambda v: turn_of(matrix_of(v)), (turns,))
    still = torch.zeros(2, 3, dtype=torch.float64, requires_grad=True)
    (jacobian,) = torch.autograd.grad(turn_of(matrix_of(still)).sum(), still)
    assert torch.allclose(jacobian, torch.ones_like(still))


def test_the_best_rotation_is_the_true_one_even_of_a_mirrored_body() -> None:
    points = torch.randn(7, 3, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    true = matrix_of(random_turns(4, 3.0, seed=3))
    end = (true @ points.T + torch.randn(4, 3, 1, dtype=torch.float64)).permute(2, 0, 1)
    assert torch.allclose(best_rotations(points, end), true, atol=1e-12)
    mirrored = best_rotations(points, -points[:, None])
    assert torch.allclose(torch.linalg.det(mirrored), torch.ones(1, dtype=torch.float64))


def random_flow(groups: int = 3, times: tuple[float, ...] = (0.125, 0.25, 0.75, 0.875)) -> GroupFlow:
    flow, steps = GroupFlow(times).double(), len(times) - 1
    generator = torch.Generator().manual_seed(4)
    flow.set(
        torch.randn(groups, 3, generator=generator, dtype=torch.float64),
        random_turns(groups * steps, 1.5, seed=5).view(groups, steps, 3),
        torch.randn(groups, steps, 3, generator=generator, dtype=torch.float64),
    )
    return flow


@pytest.mark.parametrize("t", [0.2, 0.25, 0.55, 0.8, 0.875])
def test_a_group_moves_by_the_formula(t: float) -> None:
    """R (u - p) + p + T, with T linear and R at constant speed between two times, as scipy's slerp has it."""
    flow = random_flow()
    times = [0.125, 0.25, 0.75, 0.875]
    position = torch.randn(5, 3, generator=torch.Generator().manual_seed(6), dtype=torch.float64)
    group = torch.tensor([2, 0, 1, 1, 0])
    floor = max(i for i in range(3) if times[i] < t)
    share = (t - times[floor]) / (times[floor + 1] - times[floor])
    with torch.no_grad():
        moved = flow.moved(position, group, t)
    for n, g in enumerate(group.tolist()):
        turns = [[0.0, 0, 0], *flow.turn[g].tolist()]
        shifts = [[0.0, 0, 0], *flow.shift[g].tolist()]
        before, after = (Rotation.from_rotvec(turns[floor + k]) for k in (0, 1))
        rotation = before * Rotation.from_rotvec(share * (before.inv() * after).as_rotvec())
        p = flow.center[g].detach().numpy()
        expected = rotation.apply(position[n].numpy() - p) + p
        for k in range(3):
            shift = (1 - share) * shifts[floor][k] + share * shifts[floor + 1][k]
            assert math.isclose(float(moved[n, k]), expected[k] + shift, rel_tol=1e-9, abs_tol=1e-9)


def test_nothing_moves_before_the_first_time_or_after_the_last() -> None:
    flow, position, group = random_flow(), torch.randn(4, 3, dtype=torch.float64), torch.tensor([0, 1, 2, 0])
    assert torch.equal(flow.moved(position, group, 0.125), position)
    assert torch.equal(flow.moved(position, group, 0.0), position)
    assert torch.equal(flow.moved(position, group, 0.95), flow.moved(position, group, 0.875))


def test_gradients_are_those_of_finite_differences() -> None:
    flow, group = random_flow(), torch.tensor([0, 2])
    position = torch.randn(2, 3, dtype=torch.float64, requires_grad=True)
    for t in (0.2, 0.55):
        assert torch.autograd.gradcheck(
            lambda x, *_, t=t: flow.moved(x, group, t), (position, flow.center, flow.turn, flow.shift)
        )


def test_two_bodies_become_groups_that_move_as_they_do() -> None:
    """One turns about its own middle as it travels, the other stands: what comes back is what they did."""
    generator = torch.Generator().manual_seed(7)
    driving = torch.rand(12, 3, generator=generator, dtype=torch.float64)
    standing = torch.rand(9, 3, generator=generator, dtype=torch.float64) + torch.tensor([8.0, 0, 0])
    middle = driving.mean(0)

    def places(t: float) -> Tensor:
        turn = matrix_of(torch.tensor([0.0, 0.0, 1.2 * t], dtype=torch.float64))
        moved = (driving - middle) @ turn.T + middle + torch.tensor([0.0, 3 * t, 0.0])
        return torch.cat([moved, standing])

    times = tuple(k / 10 for k in range(11))
    first, group, flow = find_groups(places, times, FlowSettings(groups=2))
    assert torch.equal(first, places(0.0))
    assert group.tolist() == [0] * 12 + [1] * 9
    with torch.no_grad():
        for t in (0.0, 0.1, 0.35, 1.0):
            assert torch.allclose(flow.moved(first, group, t), places(t), atol=1e-6), t


def test_groups_are_chosen_by_distance_and_its_spread_over_time() -> None:
    generator = torch.Generator().manual_seed(8)
    paths, seeds = (torch.randn(n, 5, 3, generator=generator, dtype=torch.float64) for n in (40, 6))
    expected = []
    for path in paths.tolist():
        costs = []
        for seed in seeds.tolist():
            distances = [math.dist(a, b) for a, b in zip(path, seed, strict=True)]
            mean = sum(distances) / 5
            spread = math.sqrt(sum((d - mean) ** 2 for d in distances) / 4)
            costs.append(0.5 * spread + 0.5 * mean)
        expected.append(costs.index(min(costs)))
    assert nearest_group(paths, seeds).tolist() == expected


def test_farthest_points_spread_out() -> None:
    line = torch.tensor([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [10, 0, 0], [6, 0, 0]])
    assert farthest_points(line, 4).tolist() == [0, 3, 4, 2]


def test_times_are_chosen_evenly_with_both_ends() -> None:
    times = tuple(range(10))
    assert evenly(times, 20) == times
    assert evenly(times, 4) == (0, 3, 6, 9)
