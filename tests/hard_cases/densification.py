"""Growing and pruning: statistics at their limits."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from aa4d.anchors.densification import Growth, Statistics, grow, transparent
from aa4d.stress.cases import Part

PART = Part("densification")


def grown(position: Tensor, centres: Tensor, gradient: Tensor, drawn: float = 100.0, **options: float) -> Growth:
    statistics = Statistics.zeros(*gradient.shape)
    statistics.gradient += gradient * drawn
    statistics.drawn += drawn
    settings = {"voxel": 0.1, "voxel_factor": 1, "levels": 1, "gradient_threshold": 1.0, "min_drawn": 40.0, "limit": 99}
    generator = torch.Generator().manual_seed(0)
    return grow(position, centres, statistics, generator=generator, **(settings | options))  # type: ignore[arg-type]


@PART.case(why="a gradient that is NaN compares to nothing", done="grows nothing, and spoils no other")
def gradient_that_is_nan() -> float:
    gradient = torch.full((1, 40), math.nan)
    alone = grown(torch.zeros(1, 3), torch.full((1, 40, 3), 2.0), gradient)
    gradient[0, :20] = 5.0
    centres = torch.full((1, 40, 3), 2.0)
    centres[0, 20:] = 7.0
    return float(len(alone.parent)) + abs(len(grown(torch.zeros(1, 3), centres, gradient).parent) - 1)


@PART.case(why="an infinite gradient sorts first", done="one anchor, at a finite place")
def gradient_that_is_infinite() -> float:
    growth = grown(torch.zeros(1, 3), torch.full((1, 40, 3), 2.0), torch.full((1, 40), math.inf))
    return 0.0 if len(growth.parent) == 1 and growth.position.isfinite().all() else math.inf


@PART.case(
    why="voxels of a tenth of a micrometre 100 m away: float32 has no such steps",
    done="grown at places that float32 has: no candidate's voxel twice",
)
def voxels_finer_than_float32() -> float:
    centres = torch.full((1, 40, 3), 100.0) + torch.rand(1, 40, 3, generator=torch.Generator().manual_seed(1)) * 1e-3
    growth = grown(torch.zeros(1, 3), centres, torch.full((1, 40), 2.0), voxel=1e-7)
    distinct = torch.unique(growth.position, dim=0)
    return float(len(growth.position) - len(distinct))


@PART.case(why="no anchors; no room for one more", done="nothing grows", each={"no anchors": 0, "no room": 1})
def nothing_to_grow(anchors: int) -> float:
    centres = torch.full((anchors, 40, 3), 2.0)
    return float(len(grown(torch.zeros(anchors, 3), centres, torch.full((anchors, 40), 2.0), limit=0).parent))


@PART.case(why="ten thousand candidates of one voxel", done="one anchor, from the strongest")
def all_candidates_in_one_voxel() -> float:
    gradient = torch.full((2, 5000), 2.0)
    gradient[1] = 3.0
    growth = grown(torch.tensor([[0.0] * 3, [9.0] * 3]), torch.full((2, 5000, 3), 2.0), gradient)
    return 0.0 if growth.parent.tolist() == [1] and len(growth.position) == 1 else math.inf


@PART.case(why="never drawn: 0 / 0", done="not counted", each={"never drawn": 0.0, "drawn once": 1.0})
def rarely_drawn(drawn: float) -> float:
    return float(len(grown(torch.zeros(1, 3), torch.full((1, 40, 3), 2.0), torch.full((1, 40), 9.0), drawn).parent))


@PART.case(why="never seen: is it transparent?", done="judged only after it was seen often enough")
def never_seen() -> float:
    statistics = Statistics.zeros(3, 4)
    statistics.seen += torch.tensor([100.0, 100.0, 10.0])
    statistics.opacity += torch.tensor([0.1, 50.0, 0.0])
    return 0.0 if transparent(statistics, min_opacity=0.005, min_seen=80).tolist() == [True, False, False] else math.inf


@PART.case(why="counts in float32 stop growing at 2^24", done="forgotten when judged, long before: an epoch at a time")
def counts_that_are_judged() -> float:
    statistics = Statistics.zeros(1, 1)
    for _ in range(300):
        statistics.seen += 1
        statistics.forget_judged(min_seen=99, min_drawn=99)
    return max(float(statistics.seen.max()) - 100, 0.0)
