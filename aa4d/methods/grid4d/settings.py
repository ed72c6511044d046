"""Settings of Grid4D and its presets; schedule, noise and growth are D3DGS's, whose code its own continues.

[Grid4D] is the published code as its configurations for HyperNeRF start it. [chosen] was settled here.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, ClassVar

from aa4d.methods.d3dgs.settings import Growth, LossWeights, Rates, ScheduledSettings
from aa4d.methods.settings import Decay
from aa4d.settings.allowed import Count, NotNegative, Pixels, Range, Share, Width

Levels = Annotated[int, Range(1, 32)]
Cells = Annotated[int, Range(2, 65_536)]


@dataclass(frozen=True, kw_only=True)
class GridRates(Rates):
    """They fall over the whole run, warm-up included."""

    deformation: Decay = Decay(1.6e-4, 1.6e-6)  # [Grid4D]
    grids: Decay = Decay(8e-3, 8e-5)  # [Grid4D] 50 times the network's


@dataclass(frozen=True)
class Calm(LossWeights):
    place: NotNegative = 1.0  # [Grid4D] squared change of the place grid's features to a point nearby
    time: NotNegative = 1.0  # [Grid4D] likewise, of the three grids of place and time
    nearby: Share = 0.005  # [Grid4D] how far a point is nearby at most, as a share of the box
    asked: Share = 1.0  # [Grid4D] share of the Gaussians that are asked


@dataclass(frozen=True)
class ModelConfig:
    features: Annotated[int, Range(1, 16)] = 2  # [Grid4D] of a vertex
    table: Annotated[int, Range(4, 22)] = 19  # [Grid4D] power of 2, rows of a level; where vertices are more they share
    place_levels: Levels = 16  # [Grid4D]
    place_coarsest: Cells = 16  # [Grid4D] vertices along an axis
    place_finest: Cells = 2048  # [Grid4D]
    time_levels: Levels = 32  # [Grid4D] of each of the grids of xyt, yzt and xzt
    time_coarsest: Cells = 16  # [Grid4D] along the first two axes and time
    time_finest: Cells = 256  # [Grid4D] along the first two axes
    instants: Cells = 64  # [Grid4D] finest vertices along time
    width: Width = 256  # [Grid4D]
    depth: Annotated[int, Range(0, 8)] = 1  # [Grid4D] layers behind the attention
    still_start: bool = False  # [chosen] the deformation starts at zero, where Grid4D's starts at random


@dataclass(frozen=True, kw_only=True)
class Grid4DSettings(ScheduledSettings):
    method: ClassVar[str] = "grid4d"

    voxel_px: Pixels = 2.0  # [chosen] one Gaussian a voxel at the start, in pixels at unit depth
    degree_every: Count = 1000  # [Grid4D] iterations after which the harmonics get a degree more
    rates: GridRates = field(default_factory=GridRates)
    loss: Calm = field(default_factory=Calm)
    model: ModelConfig = field(default_factory=ModelConfig)


PLAIN = partial(Growth, absolute=False, gradient_threshold=2e-4, statistics_from=0)  # [Grid4D]

PRESETS = {
    "quick": Grid4DSettings(
        preset="quick",
        coarse_iterations=800,
        fine_iterations=3000,
        # Each Gaussian in view asks every level: what they are bounded to is what a CPU trains in minutes.
        voxel_px=4.0,
        degree_every=300,
        # A tenth of the iterations: what deforms learns faster, and starts where the static scene is.
        rates=GridRates(position=Decay(3e-4, 3e-6), deformation=Decay(1.6e-3, 1.6e-5), grids=Decay(1.6e-2, 1.6e-4)),
        densification=PLAIN(start=100, until=1500, max_gaussians=10_000, reset_every=0),
        loss=Calm(asked=0.1),
        model=ModelConfig(
            table=15,
            place_levels=8,
            place_finest=512,
            time_levels=8,
            time_finest=128,
            instants=32,
            width=128,
            still_start=True,
        ),
    ),
    "standard": Grid4DSettings(
        preset="standard",
        coarse_iterations=1500,
        fine_iterations=12_000,
        voxel_px=3.0,
        rates=GridRates(position=Decay(2e-4, 2e-6), deformation=Decay(5e-4, 5e-6), grids=Decay(8e-3, 8e-5)),
        densification=PLAIN(start=300, until=5000, max_gaussians=20_000),
        loss=Calm(asked=0.1),
        model=ModelConfig(table=17, place_levels=12, time_levels=16, still_start=True),
    ),
    # Its configurations for HyperNeRF have no warm-up; every method here starts from a static scene.
    "paper": Grid4DSettings(
        preset="paper",
        coarse_iterations=1000,
        fine_iterations=29_000,
        densification=PLAIN(start=500, until=12_000),
    ),
}
