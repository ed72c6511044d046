"""The six-plane look-up and its penalty: places, times and texels at the edges, against the float64 twins."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from torch import Tensor

from aa4d.field.planes import FeaturePlanes
from aa4d.kernels.plane_lookup import _look_up, look_up
from aa4d.kernels.plane_penalty import _plane_penalty, plane_penalty
from aa4d.stress.cases import Part
from tests.hard_cases.errors import Function, against_twin, refusal, relative

PART = Part("plane_lookup")
BOUND = 2e-5  # the fraction between two texels has lost the bits of its whole part


def planes(channels: int = 16, scale: float = 1.0, rows: int = 5, resolution: int = 7) -> list[Tensor]:
    """Six planes of one level, no two of one size."""
    torch.manual_seed(0)
    shapes = [(resolution + 1, resolution), *[(resolution, resolution + 2)] * 2]
    shapes += [(rows, resolution + i) for i in range(3)]
    return [((torch.rand(*shape, channels) + 0.5) * scale).requires_grad_() for shape in shapes]


def at(u: Tensor, t: float, scores: Tensor | None = None) -> Callable[[Callable[..., Tensor]], Function]:
    return lambda f: lambda x: [f(x, u.to(x[0].dtype), t, None if scores is None else scores.to(x[0].dtype))]


def error(texels: list[Tensor], u: Tensor, t: float, scores: Tensor | None = None, least: float = 1e-6) -> float:
    run = at(u, t, scores)
    return against_twin(run(look_up), run(_look_up), texels, least)


def some_scores(count: int, channels: int = 16) -> Tensor:
    return torch.randn(count, 6, channels, generator=torch.Generator().manual_seed(1)) * 3


EDGES = {
    "corners": [[-1.0, 1.0, -1.0], [1.0, 1.0, 1.0], [-1.0, -1.0, -1.0]],
    "one ulp inside": [[1 - 6e-8, -1 + 6e-8, 0.0]],
    "one ulp outside": [[1 + 1.2e-7, -1 - 1.2e-7, 0.0]],
    "far outside": [[1e30, -1e30, 3e38]],
    "denormal": [[1e-45, -1e-45, 1e-40]],
    "on texels": [[-1 + 2 * i / 6, 0.0, 1.0] for i in range(7)],
}


@PART.case(
    why="the last texel has no right neighbour; outside there is none at all",
    done="clamped before the texel is chosen; the last pair serves the end",
    bound=BOUND,
    each=EDGES,
)
def places(u: list[list[float]]) -> float:
    return max(error(planes(), torch.tensor(u), 0.4, scores) for scores in (None, some_scores(len(u))))


@PART.case(
    why="t times the rows falls beyond the last row, or is no number",
    done="clamped to the first and last row",
    bound=BOUND,
    each={str(t): t for t in (0.0, 1.0, 1e-45, 1 - 6e-8, 0.25)},
)
def times(t: float) -> float:
    return error(planes(), torch.rand(9, 3), t, some_scores(9))


@PART.case(why="times outside the clip", done="the first and the last row hold on", each={"-7": -7.0, "1e30": 1e30})
def times_outside(t: float) -> float:
    u, texels = torch.rand(9, 3), planes()
    inside = look_up(texels, u, min(max(t, 0.0), 1.0), None)
    return relative(look_up(texels, u, t, None).detach(), inside.detach())


@PART.case(
    why="a plane of one texel has no second one to interpolate with; a clip of one frame has one row",
    done="the same texel twice",
    bound=BOUND,
    each={"one row of time": (1, 7), "one texel": (1, 1), "two rows": (2, 2)},
)
def smallest_planes(size: tuple[int, int]) -> float:
    rows, resolution = size
    return error(planes(4, rows=rows, resolution=resolution), torch.rand(9, 3) * 2 - 1, 0.5, some_scores(9, 4))


@PART.case(
    why="the product of six small or large features leaves float32's range",
    done="gradients as products of the others, never by division",
    bound=BOUND,
    each={f"{scale:g}": scale for scale in (1e-5, 1e-3, 1e3, 1e6)},
)
def product_of_scaled_planes(scale: float) -> float:
    return error(planes(scale=scale), torch.rand(50, 3) * 2 - 1, 0.4, least=1e-44)


@PART.case(
    why="a factor of zero: product / factor is 0 / 0",
    done="gradients as products of the other five",
    bound=BOUND,
)
def zeros_in_a_product() -> float:
    some = planes(4)
    with torch.no_grad():
        some[0].zero_()
        some[4].zero_()
    return error(some, torch.rand(9, 3), 0.2)


@PART.case(why="no anchors", done="empty features, zero gradients")
def no_anchors() -> float:
    some = planes(4)
    features = look_up(some, torch.empty(0, 3), 0.5, torch.empty(0, 6, 4))
    assert features.shape == (0, 4)
    features.sum().backward()
    return max(float(plane.grad.abs().max()) for plane in some if plane.grad is not None)


@PART.case(why="a place or a time that is NaN would be a texel's number", done="reads the first texel, nothing outside")
def nan_reads_no_texel_outside() -> float:
    u = torch.rand(3, 3)
    u[2] = math.nan
    return 0.0 if look_up(planes(), u, math.nan, torch.zeros(3, 6, 16))[2].isfinite().all() else math.inf


@PART.case(why="one NaN score of one channel", done="seen in that anchor's channel at every level, and nowhere else")
def nan_score_is_not_hidden() -> float:
    scores = torch.zeros(3, 6, 16)
    scores[1, 0, 5] = math.nan
    h = look_up([*planes(), *planes()], torch.rand(3, 3), 0.4, scores)
    return 0.0 if h.isnan().nonzero().tolist() == [[1, 5], [1, 21]] else math.inf


@PART.case(
    why="many anchors on one texel: a sum of 20,000 terms",
    done="summed in the anchors' order, the same bits from any number of threads",
    bound=1e-4,
)
def all_anchors_on_one_texel() -> float:
    return error(planes(4), torch.full((20_000, 3), 0.1), 0.3, some_scores(20_000, 4))


@PART.case(why="all anchors in one plane: the box has no height", done="counts as one unit more to both sides")
def box_without_extent() -> float:
    field = FeaturePlanes(4, (8,), 6)
    field.box.copy_(torch.tensor([[2.0, 2.0, 2.0], [2.0, 2.0, 2.0]]))
    u = field.normalise(torch.tensor([[2.0, 2.0, 2.0], [3.0, 1.0, 1e30]]))
    return relative(u, torch.tensor([[0.0, 0.0, 0.0], [1.0, -1.0, 1.0]]))


@PART.case(
    why="a box of a tenth of a micrometre 1 km from the origin has fewer float32 steps than texels",
    done="normalised places stay within [-1, 1] and finite",
)
def tiny_box_far_away() -> float:
    field = FeaturePlanes(4, (8,), 6)
    field.box.copy_(torch.tensor([[1000.0] * 3, [1000.0 + 6.2e-5] * 3]))
    u = field.normalise(torch.tensor([[1000.0] * 3, [1000.0 + 6.2e-5] * 3, [0.0] * 3]))
    return 0.0 if u.isfinite().all() and u.abs().max() <= 1 and u[0, 0] < u[1, 0] else math.inf


@PART.case(why="five planes, or scores of another width", done="refused in one sentence")
def planes_that_do_not_fit() -> float:
    u = torch.rand(3, 3)
    return max(
        refusal(ValueError, lambda: look_up(planes(4)[:5], u, 0.5, None), "six planes"),
        refusal(ValueError, lambda: look_up(planes(4), u, 0.5, torch.zeros(3, 6, 5)), "scores must be"),
    )


def penalties(some: list[Tensor]) -> float:
    smoothness, constancy = [0.3 + i for i in range(len(some))], [float(i % 3) for i in range(len(some))]
    return against_twin(
        lambda x: [plane_penalty(x, smoothness, constancy)],
        lambda x: [_plane_penalty(x, smoothness, constancy)],
        some,
        1e-30,
    )


@PART.case(
    why="planes of one and two rows have no second difference",
    done="none is taken",
    bound=1e-5,
)
def penalty_of_few_rows() -> float:
    torch.manual_seed(1)
    return penalties([torch.rand(n, 3, 4).requires_grad_() for n in (1, 2, 3, 4)])


@PART.case(
    why="squares of second differences of huge or tiny features",
    done="rows in float32, their sums in float64",
    bound=1e-5,
    each={f"{scale:g}": scale for scale in (1e-15, 1e15)},
)
def penalty_of_scaled_planes(scale: float) -> float:
    torch.manual_seed(1)
    return penalties([(torch.randn(40, 9, 16) * scale).requires_grad_() for _ in range(3)])


@PART.case(
    why="a plane that is exactly one has no slope at |1 - value|",
    done="a gradient of zero there, as in torch",
    bound=1e-5,
)
def penalty_at_one() -> float:
    return penalties([torch.ones(6, 5, 4).requires_grad_() for _ in range(3)])
