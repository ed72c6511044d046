"""Settings of 4D-GS and its presets.

[4D-GS] is the published code's `arguments/hypernerf/default.py`, which its authors advise for footage with poses from
COLMAP; rates that are multiplied there by the extent of the flight are taken for an extent of 1, the model frame's
depth. [chosen] was settled here.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from aa4d.methods.gaussians.settings import CloneAndSplit
from aa4d.methods.settings import CommonRates, Decay, RunSettings
from aa4d.settings.allowed import Count, NotNegative, Pixels, Share, Width


@dataclass(frozen=True, kw_only=True)
class Rates(CommonRates):
    position: Decay = Decay(1.6e-4, 1.6e-6)  # [4D-GS]
    log_scale: Decay = Decay(5e-3, 5e-3)  # [4D-GS]
    quaternion: Decay = Decay(1e-3, 1e-3)  # [4D-GS]
    opacity: Decay = Decay(5e-2, 5e-2)  # [4D-GS]
    sh_constant: Decay = Decay(2.5e-3, 2.5e-3)  # [4D-GS]
    sh_rest: Decay = Decay(1.25e-4, 1.25e-4)  # [4D-GS] a twentieth
    planes: Decay = Decay(1.6e-3, 1.6e-4)  # [4D-GS]
    deformation: Decay = Decay(1.6e-4, 1.6e-5)  # [4D-GS]


@dataclass(frozen=True)
class LossWeights:
    """L1 has no weight of its own."""

    dssim: Share = 0.0  # [4D-GS]
    plane_smoothness: NotNegative = 2e-4  # [4D-GS]
    time_smoothness: NotNegative = 1e-3  # [4D-GS]
    time_constancy: NotNegative = 1e-4  # [4D-GS]


@dataclass(frozen=True)
class ModelConfig:
    plane_dim: Width = 16  # [4D-GS]
    spatial_resolutions: tuple[Width, ...] = (64, 128, 256)  # [4D-GS] cells a side, one a level
    temporal_resolution: Width | None = None  # [4D-GS] rows along t; None: by the number of frames
    width: Width = 128  # [4D-GS]
    # 4D-GS does; it takes the slow path through the planes.
    still_start: bool = False  # [chosen] the deformation starts at zero, where 4D-GS's starts at random
    learn_lookup: bool = False  # [chosen] let positions learn from where they are looked up as well


@dataclass(frozen=True, kw_only=True)
class FourDGSSettings(RunSettings):
    method: ClassVar[str] = "fourdgs"

    voxel_px: Pixels = 2.0  # [chosen] one Gaussian a voxel at the start, in pixels at unit depth
    views_per_step: Count = 2  # [4D-GS] that an iteration looks at
    degree_every: Count = 1000  # [4D-GS] iterations after which the harmonics get a degree more
    rates: Rates = field(default_factory=Rates)
    densification: CloneAndSplit = field(
        default_factory=lambda: CloneAndSplit(
            statistics_from=0, start=500, until=10_000, prune_above=200_000
        )  # [4D-GS]
    )
    loss: LossWeights = field(default_factory=LossWeights)
    model: ModelConfig = field(default_factory=ModelConfig)


PRESETS = {
    "quick": FourDGSSettings(
        preset="quick",
        coarse_iterations=800,
        fine_iterations=3000,
        views_per_step=1,
        degree_every=300,
        # A tenth of the paper's iterations, of one view each, as AdaAnchor4D's preset of this name: what deforms
        # learns faster. Each Gaussian asks the networks, so no transparent one stays, and there are few (CPU).
        rates=Rates(planes=Decay(1.6e-2, 1.6e-3), deformation=Decay(1.6e-3, 1.6e-4), position=Decay(3e-4, 3e-6)),
        densification=CloneAndSplit(statistics_from=0, start=100, until=1500, max_gaussians=20_000),
        # A random start throws the static scene out by some ten pixels, which a short schedule cannot make good.
        model=ModelConfig(spatial_resolutions=(64, 128), still_start=True),
    ),
    "standard": FourDGSSettings(
        preset="standard",
        coarse_iterations=1500,
        fine_iterations=12000,
        rates=Rates(planes=Decay(5e-3, 5e-4), deformation=Decay(5e-4, 5e-5), position=Decay(2e-4, 2e-6)),
        densification=CloneAndSplit(statistics_from=0, start=300, until=5000, max_gaussians=60_000),
        model=ModelConfig(still_start=True),
    ),
    "paper": FourDGSSettings(preset="paper", coarse_iterations=3000, fine_iterations=30_000),
}
