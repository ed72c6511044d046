"""Settings that methods of free Gaussians share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from aa4d.methods.settings import DensitySchedule
from aa4d.settings.allowed import Count, Positive, Range, Share

Units = Annotated[int, Range(0, 10_000_000)]


@dataclass(frozen=True, kw_only=True)
class CloneAndSplit(DensitySchedule):
    """All 3DGS's, in the model's frame, where its "extent" is 1: the scene's depth."""

    gradient_threshold: Positive = 2e-4  # screen-space gradient, normalized device units
    largest_clone: Positive = 0.01  # scale above which a Gaussian is split
    min_opacity: Share = 0.005  # below which a Gaussian goes
    prune_above: Units = 0  # with no more Gaussians than that, none goes for being transparent
    max_gaussians: Count = 360_000  # growth stops there; what training starts with may be more
