"""Settings of MoDec-GS and its presets.

[MoDec-GS base] is the published code's `arguments/hypernerf/base.py`, [MoDec-GS split-cookie] its file for that scene,
which alone has the neural size that AdaAnchor4D's paper reports for this method. Rates that are multiplied there by the
extent of the flight are taken for an extent of 1, the model frame's depth. There a step has four views, and growing
sees of their mean loss the gradient by the last one: a quarter. Here a view counts as if it were alone, so that
thresholds are four times those of the code. [chosen] was settled here.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar, Literal

from aa4d.methods.settings import AnchorDensification, CommonRates, Decay, RunSettings
from aa4d.settings.allowed import Count, NotNegative, Pixels, Positive, Range, Share, Width


@dataclass(frozen=True, kw_only=True)
class Rates(CommonRates):
    offset: Decay = Decay(0.01, 1e-4)  # [MoDec-GS base]
    feature: Decay = Decay(0.0075, 0.0075)  # [MoDec-GS base]
    log_scale: Decay = Decay(0.007, 0.007)  # [MoDec-GS base]
    dynamics: Decay = Decay(0.002, 0.002)  # [MoDec-GS base] its schedule is never applied
    planes: Decay = Decay(1.6e-3, 1.6e-4)  # [MoDec-GS base] of both fields
    # Their names there hold the word by which planes are told from networks.
    geometry: Decay = Decay(1.6e-3, 1.6e-4)  # [MoDec-GS base] of the heads for anchors' offsets and scales
    deformation: Decay = Decay(1.6e-4, 1.6e-4)  # [MoDec-GS base] of the other heads; its schedule is never applied
    decoder_opacity: Decay = Decay(0.002, 2e-5)  # [MoDec-GS base]
    decoder_color: Decay = Decay(0.008, 5e-5)  # [MoDec-GS base]
    decoder_covariance: Decay = Decay(0.004, 0.004)  # [MoDec-GS base]


@dataclass(frozen=True, kw_only=True)
class Growth(AnchorDensification):
    """Growing and pruning of anchors, all [Scaffold-GS] unless marked; thresholds as of steps with one view."""

    gradient_threshold: Positive = 8e-4  # [MoDec-GS base, split-cookie] of the screen-space gradient
    seen_share: Share = 0.7  # [MoDec-GS base] of an interval's views, before a statistic counts
    min_opacity: Share = 0.01  # [MoDec-GS base, split-cookie] mean sum over an anchor's Gaussians, below which it goes


@dataclass(frozen=True)
class LossWeights:
    """L1 has weight 1."""

    dssim: NotNegative = 0.2  # [MoDec-GS base] beside L1
    global_smoothness: NotNegative = 1e-4  # [MoDec-GS base] of the global field's spatial planes
    global_time_smoothness: NotNegative = 5e-4  # [MoDec-GS base] of its time planes along t
    global_constancy: NotNegative = 5e-5  # [MoDec-GS base] of the distance of its time planes from 1
    local_smoothness: NotNegative = 2e-4  # [MoDec-GS base] likewise, of the local field
    local_time_smoothness: NotNegative = 1e-3  # [MoDec-GS base]
    local_constancy: NotNegative = 1e-4  # [MoDec-GS base]


@dataclass(frozen=True)
class FieldConfig:
    """Planes and the width of what they feed."""

    plane_dim: Width = 16  # [MoDec-GS base]
    spatial_resolutions: tuple[Width, ...] = (64, 128)  # [MoDec-GS base, split-cookie] cells a side, one a level
    temporal_resolution: Width | None = None  # rows along t; None: by the number of frames
    width: Width = 128  # [MoDec-GS base] of encoder and heads


@dataclass(frozen=True)
class ModelConfig:
    """Sizes and switches. The paper's ablation turns them so: one stage has `gad` off and `lgd` "anchors", two stages
    of anchors have `gad` on and `lgd` "anchors", the whole method has `lgd` "gaussians"."""

    offsets: Annotated[int, Range(1, 64)] = 10  # [MoDec-GS base] K, Gaussians of an anchor
    feature_dim: Width = 32  # [MoDec-GS base]
    decoder_hidden: Width = 32  # [MoDec-GS base]
    gad: bool = True  # [MoDec-GS base] global anchor deformation: the same over an interval of time
    intervals: Annotated[int, Range(1, 1000)] = 8  # [MoDec-GS base] of time, equally long
    lgd: Literal["gaussians", "anchors", "none"] = "gaussians"  # [MoDec-GS base] what deforms at each time itself
    gates: bool = True  # [MoDec-GS base] how dynamic each anchor is
    still_start: bool = False  # [chosen] the deformation starts at zero, where MoDec-GS's starts at random
    learn_lookup: bool = False  # [chosen] let places learn from where they are looked up as well, exact and slow


@dataclass(frozen=True, kw_only=True)
class ModecSettings(RunSettings):
    method: ClassVar[str] = "modec"

    voxel_px: Pixels = 5.0  # [chosen] edge of the finest anchor voxel, in pixels at unit depth
    views_per_step: Count = 4  # [MoDec-GS base] that an iteration looks at
    rates: Rates = field(default_factory=Rates)
    densification: Growth = field(default_factory=Growth)
    loss: LossWeights = field(default_factory=LossWeights)
    model: ModelConfig = field(default_factory=ModelConfig)
    global_field: FieldConfig = field(
        default_factory=lambda: FieldConfig(spatial_resolutions=(32, 64), temporal_resolution=10)
    )
    local_field: FieldConfig = field(default_factory=FieldConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.model.gad and self.model.lgd == "none":
            raise ValueError("model.lgd must be gaussians or anchors where model.gad is off, or nothing would move")


BASE = ModecSettings(preset="paper", coarse_iterations=3000, fine_iterations=30_000)
PRESETS = {
    # A tenth of the paper's iterations, of one view each, as AdaAnchor4D's preset of this name: what deforms learns
    # faster, and starts where the static scene is.
    "quick": ModecSettings(
        preset="quick",
        coarse_iterations=800,
        fine_iterations=3000,
        views_per_step=1,
        rates=Rates(
            planes=Decay(1.6e-2, 1.6e-3),
            geometry=Decay(1.6e-3, 1.6e-4),
            deformation=Decay(1.6e-3, 1.6e-4),
        ),
        # Growth has a tenth of the occasions: it listens to a quarter of the gradient.
        densification=Growth(statistics_from=100, start=300, until=1800, voxel_factor=4, gradient_threshold=2e-4),
        model=ModelConfig(still_start=True),
        local_field=FieldConfig(width=64),  # each Gaussian asks these networks
    ),
    "standard": ModecSettings(
        preset="standard",
        coarse_iterations=1500,
        fine_iterations=12_000,
        views_per_step=2,
        rates=Rates(
            planes=Decay(5e-3, 5e-4),
            geometry=Decay(1.6e-3, 1.6e-4),
            deformation=Decay(5e-4, 1.6e-4),
        ),
        densification=Growth(statistics_from=200, start=600, until=6000, voxel_factor=8, gradient_threshold=4e-4),
        model=ModelConfig(still_start=True),
    ),
    "paper": BASE,
    "split-cookie": replace(
        BASE,
        preset="split-cookie",
        # [MoDec-GS split-cookie]
        densification=replace(BASE.densification, gradient_threshold=2e-2, min_opacity=0.005),
        local_field=FieldConfig(spatial_resolutions=(64, 128, 256), temporal_resolution=150),
    ),
}
