"""Settings of SD-GS and its presets.

[SD-GS] is stated in its paper (arXiv 2507.07465); its code was not to be had when this was written. What the paper
takes over from others is [Scaffold-GS] or [4D-GS]; rates that are multiplied there by the extent of the flight are
taken for an extent of 1, the model frame's depth. [chosen] was settled here.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from aa4d.methods.settings import AnchorDensification, CommonRates, Decay, RunSettings
from aa4d.settings.allowed import NotNegative, Pixels, Range, Share, Width


@dataclass(frozen=True, kw_only=True)
class Rates(CommonRates):
    offset: Decay = Decay(0.01, 1e-4)  # [Scaffold-GS]
    feature: Decay = Decay(0.0075, 0.0075)  # [Scaffold-GS]
    log_scale: Decay = Decay(0.007, 0.007)  # [Scaffold-GS]
    planes: Decay = Decay(1.6e-3, 1.6e-4)  # [4D-GS]
    deformation: Decay = Decay(1.6e-4, 1.6e-5)  # [4D-GS]
    decoder_opacity: Decay = Decay(0.002, 2e-5)  # [Scaffold-GS]
    decoder_color: Decay = Decay(0.008, 5e-5)  # [Scaffold-GS]
    decoder_covariance: Decay = Decay(0.004, 0.004)  # [Scaffold-GS]


@dataclass(frozen=True, kw_only=True)
class Growth(AnchorDensification):
    """Growing and pruning of anchors, all [Scaffold-GS] unless marked."""

    by_place: NotNegative = 0.8  # [SD-GS] weight of how far an anchor moves, in what its gradients count
    by_scale: NotNegative = 0.1  # [SD-GS] likewise, of how much its scales change
    percentile: Share = 0.9  # [SD-GS] of either over a view, which counts as 1


@dataclass(frozen=True)
class LossWeights:
    dssim: Share = 0.2  # [SD-GS] D-SSIM; L1 has the rest
    volume: NotNegative = 0.01  # [SD-GS] mean volume of the drawn Gaussians
    plane_smoothness: NotNegative = 2e-4  # [4D-GS]
    time_smoothness: NotNegative = 1e-3  # [4D-GS]
    time_constancy: NotNegative = 1e-4  # [4D-GS]


@dataclass(frozen=True)
class ModelConfig:
    offsets: Annotated[int, Range(1, 64)] = 10  # [Scaffold-GS] K, Gaussians of an anchor
    feature_dim: Width = 32  # [SD-GS]
    decoder_hidden: Width = 32  # [Scaffold-GS]
    time_frequencies: Annotated[int, Range(1, 16)] = 6  # [chosen] octaves of the time that decoders see
    plane_dim: Width = 16  # [4D-GS]
    spatial_resolutions: tuple[Width, ...] = (64, 128)  # [4D-GS] cells a side, one a level
    temporal_resolution: Width | None = None  # rows along t; None: by the number of frames
    width: Width = 128  # [4D-GS] of encoder and heads
    still_start: bool = False  # [chosen] the deformation starts at zero, where 4D-GS's starts at random
    learn_lookup: bool = False  # [chosen] let positions learn from where they are looked up as well, exact and slow


@dataclass(frozen=True, kw_only=True)
class SdgsSettings(RunSettings):
    method: ClassVar[str] = "sdgs"

    voxel_px: Pixels = 5.0  # [chosen] edge of the finest anchor voxel, in pixels at unit depth
    rates: Rates = field(default_factory=Rates)
    densification: Growth = field(default_factory=Growth)
    loss: LossWeights = field(default_factory=LossWeights)
    model: ModelConfig = field(default_factory=ModelConfig)


PRESETS = {
    # Rates as those of 4D-GS's presets of these names: what deforms learns faster, and starts where the scene is.
    "quick": SdgsSettings(
        preset="quick",
        coarse_iterations=800,
        fine_iterations=3000,
        rates=Rates(planes=Decay(1.6e-2, 1.6e-3), deformation=Decay(1.6e-3, 1.6e-4)),
        densification=Growth(statistics_from=100, start=300, until=1800, voxel_factor=4),
        model=ModelConfig(still_start=True),
    ),
    "standard": SdgsSettings(
        preset="standard",
        coarse_iterations=1500,
        fine_iterations=12_000,
        rates=Rates(planes=Decay(5e-3, 5e-4), deformation=Decay(5e-4, 5e-5)),
        densification=Growth(statistics_from=200, start=600, until=6000, voxel_factor=8),
        model=ModelConfig(still_start=True),
    ),
    # 140,000 iterations of the publication were for its longer clips.
    "paper": SdgsSettings(preset="paper", coarse_iterations=3000, fine_iterations=30_000),
}
