"""Settings of MoRel and its presets.

Its code was not to be had when this was written. The structure is the publication's; the values of anchors, decoders
and growth are Scaffold-GS's, on which it rests; those of a window's planes are MoDec-GS's for its anchors, of the same
authors. What could not be known is [chosen].
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from aa4d.methods.settings import AnchorDensification, CommonRates, Decay, RunSettings
from aa4d.settings.allowed import Count, NotNegative, Pixels, Positive, Range, Share, Width

MOST_KEYS = 64


@dataclass(frozen=True, kw_only=True)
class Rates(CommonRates):
    offset: Decay = Decay(0.01, 1e-4)  # [Scaffold-GS]
    feature: Decay = Decay(0.0075, 0.0075)  # [Scaffold-GS]
    log_scale: Decay = Decay(0.007, 0.007)  # [Scaffold-GS]
    decoder_opacity: Decay = Decay(0.002, 2e-5)  # [Scaffold-GS]
    decoder_color: Decay = Decay(0.008, 5e-5)  # [Scaffold-GS]
    decoder_covariance: Decay = Decay(0.004, 0.004)  # [Scaffold-GS]
    planes: Decay = Decay(1.6e-3, 1.6e-4)  # [4D-GS]
    deformation: Decay = Decay(1.6e-4, 1.6e-5)  # [4D-GS]
    position: Decay = Decay(1.6e-4, 1.6e-5)  # [4D-GS]
    blending: Decay = Decay(0.02, 0.002)  # [chosen] of centers and decays of the weights


@dataclass(frozen=True, kw_only=True)
class Densification(AnchorDensification):
    """Growing and pruning of anchors as Scaffold-GS's; anchors whose features vary much grow later."""

    variance_quantiles: tuple[Share, Share] = (0.333, 0.667)  # [chosen] between the three levels
    delayed: Share = 0.3  # [chosen] lambda_L: of the gradient of levels above the lowest, at a stage's start

    def __post_init__(self) -> None:
        low, high = self.variance_quantiles
        if low > high:
            raise ValueError(f"variance_quantiles are {low:g} and {high:g}; the first must not be above the second")


@dataclass(frozen=True)
class LossWeights:
    dssim: Share = 0.2  # [Scaffold-GS] D-SSIM; L1 has the rest
    plane_smoothness: NotNegative = 1e-4  # [MoDec-GS] its anchors' field; of the spatial planes
    time_smoothness: NotNegative = 5e-4  # [MoDec-GS] likewise, of the time planes along t
    time_constancy: NotNegative = 5e-5  # [MoDec-GS] likewise, of the distance of time planes from 1


@dataclass(frozen=True)
class ModelConfig:
    offsets: Annotated[int, Range(1, 64)] = 10  # [Scaffold-GS] K, Gaussians of an anchor
    feature_dim: Width = 32  # [Scaffold-GS]
    decoder_hidden: Width = 32  # [Scaffold-GS]
    keys: Annotated[int, Range(2, MOST_KEYS)] | None = None  # key frames; None: by `key_interval`
    plane_dim: Width = 16  # [MoDec-GS]
    spatial_resolutions: tuple[Width, ...] = (32, 64)  # [MoDec-GS] cells a side of a window's planes, one a level
    temporal_resolution: Width = 10  # [MoDec-GS] rows along a window's time
    width: Width = 128  # [MoDec-GS] of encoder and heads
    decay_strength: Positive = 1.5  # [chosen] lambda_decay: a neighbor's key frame starts with a weight of 0.22


@dataclass(frozen=True, kw_only=True)
class MoRelSettings(RunSettings):
    method: ClassVar[str] = "morel"

    voxel_px: Pixels = 5.0  # [chosen] edge of the finest anchor voxel, in pixels at unit depth
    key_interval: Count = 12  # [chosen] frames from one key frame to the next (GOP)
    key_tolerance: Share = 0.25  # [chosen] intervals from a key frame within which its anchors are refined (epsilon)
    key_share: Share = 0.2  # [chosen] of the fine iterations, in which anchors of key frames are refined
    blend_share: Share = 0.2  # [chosen] of the fine iterations, in which the blending is learned; 0: it stays linear
    rates: Rates = field(default_factory=Rates)
    densification: Densification = field(default_factory=Densification)
    loss: LossWeights = field(default_factory=LossWeights)
    model: ModelConfig = field(default_factory=ModelConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.key_share + self.blend_share >= 1:
            raise ValueError(
                f"key_share and blend_share are {self.key_share:g} and {self.blend_share:g}; together they must leave "
                "a part of the fine iterations for the windows"
            )


PRESETS = {
    "quick": MoRelSettings(
        preset="quick",
        coarse_iterations=800,
        fine_iterations=3000,
        # A tenth of the paper's iterations, at twice the rates of 4D-GS's preset of this name, as a window gets but its
        # share of them. At AdaAnchor4D's, whose planes are not multiplied, features grew without bound.
        rates=Rates(planes=Decay(0.03, 0.003), deformation=Decay(0.003, 0.0003), position=Decay(2e-4, 2e-5)),
        densification=Densification(statistics_from=100, start=300, until=1200, voxel_factor=4),
    ),
    "standard": MoRelSettings(
        preset="standard",
        coarse_iterations=1500,
        fine_iterations=12000,
        rates=Rates(planes=Decay(5e-3, 5e-4), deformation=Decay(5e-4, 5e-5), position=Decay(1.8e-4, 1.8e-5)),
        densification=Densification(statistics_from=200, start=600, until=4000, voxel_factor=8),
    ),
    "paper": MoRelSettings(
        preset="paper",
        coarse_iterations=3000,
        fine_iterations=30000,
        densification=Densification(until=12000),  # [chosen] of the 18,000 iterations of the windows
    ),
}
