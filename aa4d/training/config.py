"""Every training setting and its preset, each with where it comes from.

[paper] is stated there. [Scaffold-GS], [4D-GS] and [MoDec-GS] are the values of those methods' published code, the
paper's own base and its nearest neighbours. [swept] was compared with other values by `aa4d sweep`: the tables are in
docs/training.md. [chosen] was settled here without such a table. Learning rates and sizes hold in the model frame
(aa4d/capture/frame.py), where the scene is at unit depth: none of them depends on metres.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated

from aa4d.settings.allowed import Count, Iterations, NameIn, NotNegative, Pixels, Positive, Range, Rate, Seed, Share

Factor = Annotated[int, Range(1, 4096)]
# In order. "clean" is the static scene once more without what seems to move; only where movers are looked for.
STAGES = ("coarse", "clean", "fine")


@dataclass(frozen=True)
class Decay:
    """A learning rate that falls exponentially from `initial` to `final` over its stage."""

    initial: Rate
    final: Rate

    def at(self, progress: float) -> float:
        """progress in [0, 1]"""
        return float(self.initial * (self.final / self.initial) ** progress)


@dataclass(frozen=True)
class LearningRates:
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
    tracks: Decay = Decay(2e-4, 2e-5)  # [chosen] model units: a hundredth of a pixel's width at focal length 250
    heading: Decay = Decay(2e-3, 2e-4)  # [chosen] radians: what turns a car's ends by as much
    poses: Decay = Decay(2e-3, 2e-5)  # [chosen] radians and model units; falls over both stages


@dataclass(frozen=True)
class Densification:
    """Growing and pruning of anchors, all [Scaffold-GS] unless marked. Iterations count within a stage."""

    statistics_from: Iterations = 500  # iteration from which they are gathered
    start: Iterations = 1500  # iteration from which anchors grow and are pruned
    interval: Count = 100  # iterations from one occasion to the next
    until: Iterations = 15000  # iteration after which neither happens
    gradient_threshold: Positive = 2e-4  # of the screen-space gradient, normalised device units
    seen_share: Share = 0.8  # of an interval's iterations, before a statistic counts
    min_opacity: Share = 0.005  # mean sum over an anchor's Gaussians, below which it is pruned
    levels: Annotated[int, Range(1, 8)] = 3  # of voxels that anchors grow into
    voxel_factor: Factor = 16  # edge of the coarsest level's voxels, in finest ones; each further level: a quarter
    max_anchors: Count = 200_000  # [chosen] a bound on memory


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
class MotionSettings:
    """Rigid groups of anchors that ride on the tracks of movers: beyond the paper (docs/motion.md)."""

    tracks: Annotated[str, NameIn("aa4d.motion.sources", "SOURCES")] = "auto"  # where they come from
    clean_iterations: Iterations = 400  # [chosen] of the static stage, once more without what seems to move
    voxel_px: Pixels = 2.0  # [chosen] edge of a rider's finest voxel, in pixels at unit depth
    learn_from: Share = 0.1  # [chosen] share of the fine stage after which trajectories are learned too
    farthest_px: NotNegative = 6.0  # [chosen] that a control point may move from where it was found
    largest_turn: Annotated[float, Range(0, 3.15)] = 0.35  # [chosen] radians, likewise
    # With nothing left to chase, the field may be calm, and learns instants less.
    time_smoothness: NotNegative = 0.1  # [swept] instead of the loss's, where anchors ride
    time_constancy: NotNegative = 1e-3  # [swept] likewise
    membership: NotNegative = 0.1  # [swept] weight of the share of riders that a pixel shows against the movers' masks

    @property
    def needs_static(self) -> bool:
        """Whether tracks are found on a static scene; the truth is known before there is one."""
        return self.tracks != "truth"


@dataclass(frozen=True)
class TrainingConfig:
    preset: str  # where the other settings start from
    coarse_iterations: Count  # of the static scene
    fine_iterations: Count  # of the scene in motion
    seed: Seed = 0  # of everything random
    voxel_px: Pixels = 5.0  # [chosen] edge of the finest anchor voxel, in pixels at unit depth
    embedding_std: NotNegative = 0.01  # [swept] of the embeddings at the start; 1 costs half a decibel
    checkpoint_every: Count = 500  # iterations; a killed run repeats at most so many
    refine_poses: bool = False  # learn the training cameras' poses with the scene
    motion: MotionSettings | None = None  # anchors that ride on movers; None: the paper
    rates: LearningRates = field(default_factory=LearningRates)
    densification: Densification = field(default_factory=Densification)
    warp: WarpSettings = field(default_factory=WarpSettings)
    loss: LossWeights = field(default_factory=LossWeights)

    def iterations(self, stage: str) -> int:
        """Of one of `STAGES`."""
        clean = self.motion.clean_iterations if self.motion is not None and self.motion.needs_static else 0
        return {"coarse": self.coarse_iterations, "clean": clean, "fine": self.fine_iterations}[stage]

    def iterations_before(self, stage: str) -> int:
        return sum(self.iterations(earlier) for earlier in STAGES[: STAGES.index(stage)])

    @property
    def total_iterations(self) -> int:
        return sum(self.iterations(stage) for stage in STAGES)


PRESETS = {
    "quick": TrainingConfig(
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
    "standard": TrainingConfig(
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
    "paper": TrainingConfig(preset="paper", coarse_iterations=3000, fine_iterations=30000),  # [paper]
}


def with_iterations(config: TrainingConfig, coarse: int, fine: int) -> TrainingConfig:
    """The same settings over another number of iterations; when anchors grow scales with the fine stage's."""
    share = fine / config.fine_iterations
    d = config.densification
    window = {name: round(getattr(d, name) * share) for name in ("statistics_from", "start", "until")}
    return replace(config, coarse_iterations=coarse, fine_iterations=fine, densification=replace(d, **window))


def temporal_resolution(frames: int) -> int:
    """Half the number of frames, as 4D-GS advises, within what its configurations use."""
    return min(max(round(frames / 2), 25), 150)
