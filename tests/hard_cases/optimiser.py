"""The optimiser, learning rates, poses that are learned, and the watch for what is not finite."""

from __future__ import annotations

import math

import torch
from scipy.spatial.transform import Rotation
from torch import Tensor
from torch.optim import Adam

from aa4d.methods.settings import Decay
from aa4d.stress.cases import Part
from aa4d.training.optimiser import replace_rows
from aa4d.training.poses import exponential, gauge_directions
from aa4d.training.watchdog import NotFinite, check_finite

PART = Part("optimiser")
BETAS, EPS = (0.9, 0.999), 1e-15


def adam(parameter: Tensor, rate: float = 0.01) -> Adam:
    return Adam([{"params": [parameter], "name": "x"}], lr=rate, betas=BETAS, eps=EPS, fused=True)


@PART.case(
    why="gradients of a mean over millions of pixels, or of a needle: their squares leave float32",
    done="eps of 1e-15, as in 3DGS; against Adam's formula in float64",
    bound=1e-4,
    each={f"{size:g}": size for size in (1e-17, 1e-10, 1.0, 1e10, 1e18)},
)
def gradients_of_size(size: float) -> float:
    x = torch.nn.Parameter(torch.zeros(5))
    optimiser = adam(x)
    gradient = torch.tensor([1.0, -2.0, 0.5, 3.0, -0.1]) * size
    m = v = truth = torch.zeros(5, dtype=torch.float64)
    for step in range(1, 21):
        x.grad = gradient.clone()
        optimiser.step()
        g = gradient.double()
        m, v = BETAS[0] * m + (1 - BETAS[0]) * g, BETAS[1] * v + (1 - BETAS[1]) * g**2
        truth = truth - 0.01 * (m / (1 - BETAS[0] ** step)) / ((v / (1 - BETAS[1] ** step)).sqrt() + EPS)
    return float((x.detach().double() - truth).abs().max() / truth.abs().max())


@PART.case(why="a gradient whose square is infinite", done="no step, and nothing that is not finite")
def gradient_whose_square_overflows() -> float:
    x = torch.nn.Parameter(torch.ones(3))
    optimiser = adam(x)
    x.grad = torch.tensor([1e30, -1e30, 0.0])
    optimiser.step()
    return 0.0 if x.isfinite().all() else math.inf


@PART.case(
    why="what learning made infinite is copied into a checkpoint",
    done="found before it is saved, with the group's name",
    each={"a gradient": "a gradient", "a parameter": "a parameter", "a moment": "moment"},
)
def what_is_not_finite(where: str) -> float:
    x = torch.nn.Parameter(torch.ones(3))
    optimiser = adam(x)
    x.grad = torch.ones(3)
    optimiser.step()
    if where == "a gradient":
        x.grad[1] = math.nan
    elif where == "a parameter":
        x.data[1] = math.inf
    else:
        optimiser.state[x]["exp_avg_sq"][2] = math.nan
    try:
        check_finite(optimiser, "a gradient" if where == "a gradient" else "a parameter")
    except NotFinite as found:
        return 0.0 if found.groups == ("x",) else math.inf
    return math.inf


@PART.case(
    why="a rate that decays by orders; no iterations to decay over",
    done="interpolated in the logarithm, exact at both ends",
    bound=1e-12,
    each={"six orders": (1e-2, 1e-8), "constant": (1e-3, 1e-3), "grows": (1e-12, 1.0)},
)
def decay_at_its_ends(rates: tuple[float, float]) -> float:
    rate = Decay(*rates)
    found = [rate.at(0.0) / rates[0], rate.at(1.0) / rates[1], rate.at(0.5) / math.sqrt(rates[0] * rates[1])]
    return max(abs(value - 1) for value in found)


@PART.case(
    why="anchors that go and come while Adam remembers", done="moments follow their rows; new ones start at zero"
)
def moments_of_rows_that_move() -> float:
    old = torch.nn.Parameter(torch.randn(4, 2))
    optimiser = adam(old)
    old.grad = torch.randn(4, 2)
    optimiser.step()
    before = optimiser.state[old]["exp_avg"].clone()
    new = torch.nn.Parameter(torch.zeros(3, 2))
    replace_rows(optimiser, old, new, torch.tensor([3, -1, 0]))
    expected = torch.stack([before[3], torch.zeros(2), before[0]])
    return float((optimiser.state[new]["exp_avg"] - expected).abs().max())


@PART.case(why="all anchors go at once", done="empty moments")
def rows_that_all_go() -> float:
    old = torch.nn.Parameter(torch.randn(4, 2))
    optimiser = adam(old)
    old.grad = torch.randn(4, 2)
    optimiser.step()
    new = torch.nn.Parameter(torch.zeros(0, 2))
    replace_rows(optimiser, old, new, torch.zeros(0, dtype=torch.long))
    new.grad = torch.zeros(0, 2)
    optimiser.step()
    return float(optimiser.state[new]["exp_avg"].numel())


@PART.case(
    why="sin x / x and (1 - cos x) / x^2 at and around zero, and beyond a turn",
    done="series below a thousandth of a radian; against scipy in float64",
    bound=1e-12,
    each={f"{size:g} rad": size for size in (0.0, 1e-300, 1e-12, 9.9e-4, 1.01e-3, 3.14159265, 6.5, 100.0)},
)
def exponential_of_size(size: float) -> float:
    omega = torch.tensor([0.48, -0.6, 0.64], dtype=torch.float64) * size
    found = exponential(torch.cat([omega, torch.zeros(3, dtype=torch.float64)]))[:3, :3]
    return float((found - torch.tensor(Rotation.from_rotvec(omega.numpy()).as_matrix())).abs().max())


@PART.case(
    why="the same in float32, where 1 - cos x has no digits",
    done="the series' threshold leaves four of them, and the rotation stays one",
    bound=2e-6,
    each={f"{size:g} rad": size for size in (1e-30, 1e-5, 9.9e-4, 1.01e-3, 0.01, 1.0)},
)
def exponential_in_float32(size: float) -> float:
    rotation = exponential(torch.tensor([0.48 * size, -0.6 * size, 0.64 * size, 0, 0, 0]))[:3, :3].double()
    return float((rotation @ rotation.T - torch.eye(3).double()).abs().max())


@PART.case(
    why="its gradient divides by the angle",
    done="the square root is not touched where the series holds",
    each={f"{size:g} rad": size for size in (0.0, 1e-30, 1e-3)},
)
def gradient_of_the_exponential(size: float) -> float:
    twist = torch.tensor([size, 0, 0, 1.0, 2.0, 3.0], requires_grad=True)
    exponential(twist).sum().backward()
    assert twist.grad is not None
    return 0.0 if twist.grad.isfinite().all() else math.inf


@PART.case(
    why="cameras in one place have no scale of their own: a direction of zero length",
    done="left out of the basis, which stays orthonormal",
    bound=1e-9,
    each={"one camera": 1, "three in one place": 3},
)
def gauge_of_cameras_in_one_place(count: int) -> float:
    basis = gauge_directions(torch.eye(4).repeat(count, 1, 1))
    return float((basis.T @ basis - torch.eye(basis.shape[1]).double()).abs().max())
