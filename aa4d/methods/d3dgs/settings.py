"""Settings of D3DGS and its presets.

[D3DGS] is in both published branches of its code, `paper` and `main`; [D3DGS paper] and [D3DGS main] are where they
differ. [chosen] was settled here.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from aa4d.methods.gaussians.settings import CloneAndSplit
from aa4d.methods.settings import CommonRates, Decay, RunSettings
from aa4d.settings.allowed import Count, Iterations, Pixels, Positive, Share, Width


@dataclass(frozen=True, kw_only=True)
class Rates(CommonRates):
    """They fall over the whole run, warm-up included."""

    # 1.6e-4, times 5 whatever the scene, in scenes whose cameras stand some 4 to 5 units off.
    position: Decay = Decay(1.8e-4, 1.8e-6)  # [D3DGS] per unit of depth
    log_scale: Decay = Decay(5e-3, 5e-3)  # [D3DGS] 1e-3, times 5
    quaternion: Decay = Decay(1e-3, 1e-3)  # [D3DGS]
    opacity: Decay = Decay(5e-2, 5e-2)  # [D3DGS]
    sh_constant: Decay = Decay(2.5e-3, 2.5e-3)  # [D3DGS]
    sh_rest: Decay = Decay(1.25e-4, 1.25e-4)  # [D3DGS] a twentieth
    deformation: Decay = Decay(8e-4, 1.6e-6)  # [D3DGS]


@dataclass(frozen=True, kw_only=True)
class Growth(CloneAndSplit):
    """3DGS's, with a bound on scales once opacities were reset."""

    absolute: bool = True  # [D3DGS main] judge by the gradient whose pixels' shares are summed without their signs
    gradient_threshold: Positive = 7e-4  # [D3DGS main] of the screen-space gradient, normalized device units
    largest_scale: Positive = 0.1  # [D3DGS] above which a Gaussian goes, once opacities were reset
    reset_every: Iterations = 3000  # [D3DGS] iterations after which opacities are lowered to 0.01; 0: never


@dataclass(frozen=True)
class TimeNoise:
    """Noise on the time of a training view: a normal number, times the mean interval between views, times a factor."""

    initial: Share = 0.1  # [D3DGS] the factor when training starts
    until: Share = 0.5  # [D3DGS] share of the run over which it falls to zero


@dataclass(frozen=True)
class LossWeights:
    dssim: Share = 0.2  # [D3DGS] D-SSIM; L1 has the rest


@dataclass(frozen=True)
class ModelConfig:
    width: Width = 256  # [D3DGS] of each layer
    depth: Count = 8  # [D3DGS] layers
    skip: Count = 4  # [D3DGS] number, from 0, of the layer after which the input enters once more
    place_frequencies: Count = 10  # [D3DGS] octaves from 1 radian per unit
    time_frequencies: Count = 10  # [D3DGS] likewise, per clip
    still_start: bool = False  # [chosen] the deformation starts at zero, where D3DGS's starts at random

    def __post_init__(self) -> None:
        if not self.skip < self.depth - 1:
            raise ValueError(f"skip is {self.skip}: no layer of {self.depth} follows it")


@dataclass(frozen=True, kw_only=True)
class ScheduledSettings(RunSettings):
    """Of a method that continues D3DGS: warm-up, time noise, growth and harmonics go by its schedule."""

    has_two_layer: ClassVar[bool] = False

    voxel_px: Pixels = 2.0  # [chosen] one Gaussian a voxel at the start, in pixels at unit depth
    degree_every: Count = 1000  # [D3DGS] iterations after which the harmonics get a degree more
    rates: Rates = field(default_factory=Rates)
    # Growth ends with iteration 15,000 of the run.
    densification: Growth = field(default_factory=lambda: Growth(statistics_from=0, start=500, until=12_000))  # [D3DGS]
    noise: TimeNoise = field(default_factory=TimeNoise)
    loss: LossWeights = field(default_factory=LossWeights)


@dataclass(frozen=True, kw_only=True)
class D3DGSSettings(ScheduledSettings):
    method: ClassVar[str] = "d3dgs"

    model: ModelConfig = field(default_factory=ModelConfig)


PRESETS = {
    "quick": D3DGSSettings(
        preset="quick",
        coarse_iterations=800,
        fine_iterations=3000,
        # Each Gaussian in view costs the network half a million multiplications three times an iteration: what they
        # are bounded to is what a CPU trains in minutes.
        voxel_px=4.0,
        degree_every=300,
        # A tenth of the iterations: what deforms learns faster.
        rates=Rates(position=Decay(3e-4, 3e-6), deformation=Decay(4e-3, 4e-5)),
        densification=Growth(statistics_from=0, start=100, until=1500, max_gaussians=10_000, reset_every=0),
        # A random start throws the static scene out by some ten pixels, which a short schedule cannot make good.
        model=ModelConfig(still_start=True),
    ),
    "standard": D3DGSSettings(
        preset="standard",
        coarse_iterations=1500,
        fine_iterations=12_000,
        voxel_px=3.0,
        rates=Rates(position=Decay(2e-4, 2e-6), deformation=Decay(8e-4, 4e-6)),
        densification=Growth(statistics_from=0, start=300, until=5000, max_gaussians=20_000),
        model=ModelConfig(still_start=True),
    ),
    "paper": D3DGSSettings(
        preset="paper",
        coarse_iterations=3000,
        fine_iterations=37_000,
        densification=Growth(
            statistics_from=0, start=500, until=12_000, absolute=False, gradient_threshold=2e-4
        ),  # [D3DGS paper]
    ),
    "main": D3DGSSettings(preset="main", coarse_iterations=3000, fine_iterations=37_000),
}
