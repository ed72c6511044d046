"""Every setting of AdaAnchor4D and its presets, each with where it comes from (aa4d/methods/settings.py explains)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from aa4d.methods.settings import AnchorDensification, AnchorSettings, CommonRates, Decay
from aa4d.settings.allowed import NameIn, NotNegative, Range, Share, Width


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


@dataclass(frozen=True)
class WarpSettings:
    """DACW: what the paper leaves open (64 bins are the model's). No value swept stood out from the seeds' spread."""

    smoothing: NotNegative = 1.5  # [swept] of the histogram, standard deviation in bins
    gamma: NotNegative = 1.0  # [swept] sensitivity to density
    lambda_min: Share = 0.2  # [swept] least strength of the adaptation
    lambda_max: Share = 0.8  # [swept] greatest strength of the adaptation

    def __post_init__(self) -> None:
        if self.lambda_min > self.lambda_max:
            raise ValueError(f"lambda_min is {self.lambda_min:g}, above lambda_max, which is {self.lambda_max:g}")


@dataclass(frozen=True)
class LossWeights:
    """Of image and plane terms; the paper states none of them."""

    dssim: Share = 0.2  # [Scaffold-GS] D-SSIM; L1 has the rest
    volume: NotNegative = 0.01  # [Scaffold-GS] mean volume of the drawn Gaussians
    plane_smoothness: NotNegative = 2e-4  # [MoDec-GS] its local field; of the spatial planes
    time_smoothness: NotNegative = 1e-3  # [MoDec-GS] of the time planes along t
    time_constancy: NotNegative = 1e-4  # [MoDec-GS] of the distance of time planes from 1


@dataclass(frozen=True)
class ModelConfig:
    """Sizes and switches."""

    offsets: Annotated[int, Range(1, 64)] = 10  # [Scaffold-GS] K, Gaussians of an anchor
    feature_dim: Width = 32  # [Scaffold-GS]
    embedding_dim: Width = 32  # [paper]
    plane_dim: Width = 16  # [4D-GS] C; with 64 and 128 rows it gives the paper's neural sizes (docs/training.md)
    spatial_resolutions: tuple[Width, ...] = (64, 128)  # [4D-GS] cells a side, one a level
    temporal_resolution: Width | None = None  # rows along t; None: by the number of frames
    dlgd: bool = True  # off: offsets and scales do not deform
    dacw: bool = True  # off: the planes are queried at linearly normalized coordinates
    bins: Annotated[int, Range(1, 4096)] = 64  # [paper] of DACW
    weight_hidden: Width = 256  # [paper] of Phi_w
    geometry_hidden: Width = 128  # [paper] of Phi_o, Phi_s
    encoder_width: Width = 128  # [MoDec-GS] of what heads take
    decoder_hidden: Width = 32  # [Scaffold-GS]
    aggregation: Annotated[str, NameIn("aa4d.methods.adaanchor4d.aggregations", "AGGREGATIONS")] = "acfa"  # [paper]


@dataclass(frozen=True, kw_only=True)
class AdaAnchor4DSettings(AnchorSettings):
    method: ClassVar[str] = "adaanchor4d"

    embedding_std: NotNegative = 0.01  # [swept] of the embeddings at the start; 1 costs half a decibel
    rates: LearningRates = field(default_factory=LearningRates)
    densification: AnchorDensification = field(default_factory=AnchorDensification)
    warp: WarpSettings = field(default_factory=WarpSettings)
    loss: LossWeights = field(default_factory=LossWeights)
    model: ModelConfig = field(default_factory=ModelConfig)


PRESETS = {
    "quick": AdaAnchor4DSettings(
        preset="quick",
        coarse_iterations=800,
        fine_iterations=3000,
        # A tenth of the paper's iterations: planes learn at 6 times the rate, networks at 3 times, and anchors settle
        # early. At 6 times the softmax of Phi_w could saturate, and the scene stayed static (docs/training.md).
        rates=LearningRates(
            planes=Decay(0.1, 0.01),
            deformation=Decay(0.005, 0.0005),
            position=Decay(2e-4, 2e-5),
            embedding=Decay(0.01, 0.001),
        ),
        densification=AnchorDensification(statistics_from=100, start=300, until=1800, voxel_factor=4),
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
        densification=AnchorDensification(statistics_from=200, start=600, until=6000, voxel_factor=8),
    ),
    "paper": AdaAnchor4DSettings(preset="paper", coarse_iterations=3000, fine_iterations=30000),  # [paper]
}
