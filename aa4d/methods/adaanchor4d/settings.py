"""Every setting of AdaAnchor4D and its presets, each with where it comes from (aa4d/methods/settings.py explains)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from aa4d.methods.settings import AnchorSettings, CommonRates, Decay, DensitySchedule


@dataclass(frozen=True, kw_only=True)
class LearningRates(CommonRates):
    """One for each parameter group, by the name of the module or anchor attribute."""

    offset: Decay = Decay(0.01, 1e-4)  # [Scaffold-GS]
    feature: Decay = Decay(0.0075, 0.0075)  # [Scaffold-GS]
    log_scale: Decay = Decay(0.007, 0.007)  # [Scaffold-GS]
    embedding: Decay = Decay(0.0075, 7.5e-4)  # [chosen] as an anchor's feature, but settling
    planes: Decay = Decay(1.6e-2, 1.6e-3)  # [chosen] 10 x 4D-GS, whose rates scale with the extent of the scene
    deformation: Decay = Decay(1.6e-3, 1.6e-4)  # [chosen] likewise
    position: Decay = Decay(1.6e-4, 1.6e-5)  # [4D-GS], without its factor
    decoder_opacity: Decay = Decay(0.002, 2e-5)  # [Scaffold-GS]
    decoder_color: Decay = Decay(0.008, 5e-5)  # [Scaffold-GS]
    decoder_covariance: Decay = Decay(0.004, 0.004)  # [Scaffold-GS]


@dataclass(frozen=True, kw_only=True)
class Densification(DensitySchedule):
    """Growing and pruning of anchors, all [Scaffold-GS], their schedule too, unless marked."""

    gradient_threshold: float = 2e-4  # of the screen-space gradient, normalised device units
    seen_share: float = 0.8  # of an interval's iterations, before a statistic counts
    min_opacity: float = 0.005
    levels: int = 3
    voxel_factor: int = 16  # of the coarsest level; each further level is 4 times finer
    max_anchors: int = 200_000  # [chosen] a bound on memory


@dataclass(frozen=True)
class WarpSettings:
    """DACW: what the paper leaves open (64 bins are the model's). No value swept stood out from the seeds' spread."""

    smoothing: float = 1.5  # [swept] bins
    gamma: float = 1.0  # [swept]
    lambda_min: float = 0.2  # [swept]
    lambda_max: float = 0.8  # [swept]


@dataclass(frozen=True)
class LossWeights:
    """Of image and plane terms; the paper states none of them."""

    dssim: float = 0.2  # [Scaffold-GS] D-SSIM; L1 has the rest
    volume: float = 0.01  # [Scaffold-GS] mean volume of the drawn Gaussians
    plane_smoothness: float = 2e-4  # [MoDec-GS] its local field
    time_smoothness: float = 1e-3  # [MoDec-GS]
    time_constancy: float = 1e-4  # [MoDec-GS]


@dataclass(frozen=True)
class ModelConfig:
    """Sizes and switches."""

    offsets: int = 10  # K [Scaffold-GS]
    feature_dim: int = 32  # [Scaffold-GS]
    embedding_dim: int = 32  # [paper]
    plane_dim: int = 16  # C [4D-GS]; with 64 and 128 rows it gives the paper's neural sizes (docs/training.md)
    spatial_resolutions: tuple[int, ...] = (64, 128)  # one a level [4D-GS]
    temporal_resolution: int | None = None  # rows along t; None: by the number of frames
    dlgd: bool = True  # off: offsets and scales do not deform
    dacw: bool = True  # off: the planes are queried at linearly normalised coordinates
    bins: int = 64  # [paper] of DACW
    weight_hidden: int = 256  # [paper] of Phi_w
    geometry_hidden: int = 128  # [paper] of Phi_o, Phi_s
    encoder_width: int = 128  # [MoDec-GS]
    decoder_hidden: int = 32  # [Scaffold-GS]
    aggregation: str = "acfa"  # [paper] a name in aggregation.py


@dataclass(frozen=True, kw_only=True)
class AdaAnchor4DSettings(AnchorSettings):
    method: ClassVar[str] = "adaanchor4d"

    embedding_std: float = 0.01  # [swept] of the embeddings at the start; 1 costs half a decibel
    rates: LearningRates = field(default_factory=LearningRates)
    densification: Densification = field(default_factory=Densification)
    warp: WarpSettings = field(default_factory=WarpSettings)
    loss: LossWeights = field(default_factory=LossWeights)
    model: ModelConfig = field(default_factory=ModelConfig)


PRESETS = {
    "quick": AdaAnchor4DSettings(
        preset="quick",
        coarse_iterations=800,
        fine_iterations=3000,
        # A tenth of the paper's iterations: planes learn at 6 times the rate, networks at 3 times, and anchors settle
        # early. At 6 times Phi_w saturated in one of 16 short runs: its softmax put over half of the weight on one
        # plane in 59 % of the channels, and the scene stayed static (docs/training.md).
        rates=LearningRates(
            planes=Decay(0.1, 0.01),
            deformation=Decay(0.005, 0.0005),
            position=Decay(2e-4, 2e-5),
            embedding=Decay(0.01, 0.001),
        ),
        densification=Densification(statistics_from=100, start=300, until=1800, voxel_factor=4),
    ),
    "standard": AdaAnchor4DSettings(
        preset="standard",
        coarse_iterations=1500,
        fine_iterations=12000,
        # Between the two others, geometrically, as its schedule is.
        rates=LearningRates(
            planes=Decay(0.04, 0.004),
            deformation=Decay(0.003, 0.0003),
            position=Decay(1.8e-4, 1.8e-5),
            embedding=Decay(0.0085, 8.5e-4),
        ),
        densification=Densification(statistics_from=200, start=600, until=6000, voxel_factor=8),
    ),
    "paper": AdaAnchor4DSettings(preset="paper", coarse_iterations=3000, fine_iterations=30000),  # [paper]
}
