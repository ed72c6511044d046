"""Settings of 4D-SFGS and its presets.

[4D-SFGS] is the published code as its script for N3DV starts it. Times there and here are in seconds, lengths here are
those of the model's frame. [chosen] was settled here.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from aa4d.methods.settings import AnchorDensification, CommonRates, Decay, RunSettings
from aa4d.settings.allowed import NotNegative, Pixels, Positive, Range, Share, Width


@dataclass(frozen=True, kw_only=True)
class Rates(CommonRates):
    offset: Decay = Decay(0.01, 1e-4)  # [4D-SFGS] in space and time
    feature: Decay = Decay(0.0075, 0.0075)  # [4D-SFGS]
    log_scale: Decay = Decay(0.007, 0.007)  # [4D-SFGS]
    decoder_opacity: Decay = Decay(0.002, 2e-5)  # [4D-SFGS]
    decoder_color: Decay = Decay(0.008, 5e-5)  # [4D-SFGS]
    decoder_covariance: Decay = Decay(0.004, 0.004)  # [4D-SFGS] of how long Gaussians last, too
    decoder_velocity: Decay = Decay(1e-3, 1e-3)  # [4D-SFGS]


@dataclass(frozen=True, kw_only=True)
class Growth(AnchorDensification):
    """Growing and pruning of anchors in space and time, all [4D-SFGS], that is Scaffold-GS's, unless marked."""

    cell_frames: Positive = 1.0  # [4D-SFGS] duration of a voxel, in frames
    gamma: NotNegative = 1.0  # [4D-SFGS] exponent of the rate of fading, by which growing weighs Gaussians


@dataclass(frozen=True)
class LossWeights:
    """L1 has the rest."""

    dssim: Share = 0.2  # [4D-SFGS]
    volume: NotNegative = 0.01  # [4D-SFGS] mean volume of the drawn Gaussians


@dataclass(frozen=True)
class ModelConfig:
    offsets: Annotated[int, Range(1, 64)] = 10  # [4D-SFGS] K, Gaussians of an anchor
    feature_dim: Width = 32  # [4D-SFGS]
    decoder_hidden: Width = 32  # [4D-SFGS]
    beta: Annotated[float, Range(1, 16)] = 4.0  # [4D-SFGS] exponent of fading: larger ones make it more sudden
    fastest: Positive = 1.0  # [4D-SFGS] bound of each component of a velocity, model units a second
    still_start: bool = False  # [chosen] velocities start at zero, where those of 4D-SFGS start at random


@dataclass(frozen=True, kw_only=True)
class SfgsSettings(RunSettings):
    method: ClassVar[str] = "sfgs"

    voxel_px: Pixels = 5.0  # [chosen] edge of the finest anchor voxel, in pixels at unit depth
    rates: Rates = field(default_factory=Rates)
    densification: Growth = field(default_factory=Growth)
    loss: LossWeights = field(default_factory=LossWeights)
    model: ModelConfig = field(default_factory=ModelConfig)


PRESETS = {
    # A tenth of the paper's iterations: velocities learn faster, and start from none.
    "quick": SfgsSettings(
        preset="quick",
        coarse_iterations=800,
        fine_iterations=3000,
        rates=Rates(decoder_velocity=Decay(3e-3, 1e-3)),
        densification=Growth(statistics_from=100, start=300, until=1800, voxel_factor=4),
        model=ModelConfig(still_start=True),
    ),
    "standard": SfgsSettings(
        preset="standard",
        coarse_iterations=1500,
        fine_iterations=12_000,
        rates=Rates(decoder_velocity=Decay(2e-3, 1e-3)),
        densification=Growth(statistics_from=200, start=600, until=6000, voxel_factor=8),
        model=ModelConfig(still_start=True),
    ),
    "paper": SfgsSettings(preset="paper", coarse_iterations=3000, fine_iterations=30_000),
}
