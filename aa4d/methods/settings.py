"""Settings that every method has; a method's own stand in its folder, in a dataclass that extends `RunSettings`.

[paper] is stated there. [Scaffold-GS], [4D-GS] and [MoDec-GS] are the values of those methods' published code, the
paper's own base and its nearest neighbours. [swept] was compared with other values by `aa4d sweep`: the tables are in
docs/training.md. [chosen] was settled here without such a table. Learning rates and sizes hold in the model frame
(aa4d/capture/frame.py), where the scene is at unit depth: none of them depends on metres.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, TypeVar

from aa4d.settings.allowed import Count, Iterations, NameIn, NotNegative, Pixels, Positive, Range, Rate, Seed, Share


@dataclass(frozen=True)
class Decay:
    """A learning rate that falls exponentially from `initial` to `final` over its stage."""

    initial: Rate
    final: Rate

    def at(self, progress: float) -> float:
        """progress in [0, 1]"""
        return float(self.initial * (self.final / self.initial) ** progress)


@dataclass(frozen=True, kw_only=True)
class CommonRates:
    """One learning rate for each parameter group, by its name; a method adds its own groups."""

    tracks: Decay = Decay(2e-4, 2e-5)  # [chosen] model units: a hundredth of a pixel's width at focal length 250
    heading: Decay = Decay(2e-3, 2e-4)  # [chosen] radians: what turns a car's ends by as much
    poses: Decay = Decay(2e-3, 2e-5)  # [chosen] radians and model units; falls over all stages
    exposures: Decay = Decay(2e-3, 2e-4)  # [chosen] of color in [0, 1]; falls over all stages


@dataclass(frozen=True, kw_only=True)
class DensitySchedule:
    """When units come and go. Iterations count within a stage."""

    statistics_from: Iterations = 500  # iteration from which they are gathered
    start: Iterations = 1500  # iteration from which units come and go
    interval: Count = 100  # iterations from one occasion to the next
    until: Iterations = 15000  # iteration after which none comes or goes


@dataclass(frozen=True, kw_only=True)
class AnchorDensification(DensitySchedule):
    """Growing and pruning of anchors, all [Scaffold-GS], their schedule too, unless marked."""

    gradient_threshold: Positive = 2e-4  # screen-space gradient, normalized device units
    seen_share: Share = 0.8  # of an interval's iterations, before a statistic counts
    min_opacity: Share = 0.005  # mean sum over an anchor's Gaussians, below which it is pruned
    levels: Annotated[int, Range(1, 8)] = 3  # of voxels that anchors grow into
    voxel_factor: Annotated[int, Range(1, 4096)] = 16  # edge of the coarsest voxels, in finest ones; then quarters
    max_anchors: Count = 200_000  # [chosen] a bound on memory


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


@dataclass(frozen=True, kw_only=True)
class RunSettings:
    """What training asks of any method's settings. `method` is its name in `aa4d.methods.METHODS`."""

    method: ClassVar[str]
    has_two_layer: ClassVar[bool] = True  # networks whose arithmetic can be chosen

    preset: str  # where the other settings start from
    coarse_iterations: Count  # of the canonical scene, in which nothing moves
    fine_iterations: Count  # of the scene in motion
    seed: Seed = 0  # of everything random
    checkpoint_every: Count = 500  # iterations; a killed run repeats at most so many
    refine_poses: bool = False  # learn the training cameras' poses with the scene
    exposure: bool = False  # learn an affine map of color for each training view: the camera's exposure
    leave_out: bool = False  # the loss does not see what is white in CAPTURE/left_out/NAME.png, or all.png
    true_depth: NotNegative = 0.0  # weight of the relative error of depth, where the capture has true depth
    arithmetic: Annotated[str, NameIn("aa4d.kernels.two_layer", "ARITHMETIC")] = "float32"  # of two-layer networks
    motion: MotionSettings | None = None  # anchors that ride on movers; None: nothing rides
    rates: CommonRates
    densification: DensitySchedule

    def __post_init__(self) -> None:
        if self.arithmetic != "float32" and not self.has_two_layer:
            raise ValueError(f"arithmetic must be float32, for the networks of {self.method} know no other")
        if self.motion is not None and not isinstance(self, AnchorSettings):
            raise ValueError(f"motion must be none, for {self.method} has no anchors that could ride")


@dataclass(frozen=True, kw_only=True)
class AnchorSettings(RunSettings):
    """Of a method whose units are anchors: they can ride on rigid groups."""

    voxel_px: Pixels = 5.0  # [chosen] edge of the finest anchor voxel, in pixels at unit depth
    embedding_std: NotNegative = 0.0  # of the anchors' embeddings at the start, where the method has any


Settings = TypeVar("Settings", bound=RunSettings)


def with_iterations(settings: Settings, coarse: int, fine: int) -> Settings:
    """The same over another number of iterations; when units come and go scales with the fine stage's."""
    share = fine / settings.fine_iterations
    d = settings.densification
    window: dict[str, Any] = {n: round(getattr(d, n) * share) for n in ("statistics_from", "start", "until")}
    return replace(settings, coarse_iterations=coarse, fine_iterations=fine, densification=replace(d, **window))


def temporal_resolution(frames: int) -> int:
    """Rows of a time plane: half the number of frames, as 4D-GS advises, within what its configurations use."""
    return min(max(round(frames / 2), 25), 150)
