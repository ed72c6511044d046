"""Settings of SpeeDe3DGS and its presets; what is not here is D3DGS's, in its branch `main`.

[SpeeDe3DGS] is the published code. Iterations there are shares of its 30,000 here. [chosen] was settled here.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from aa4d.methods.d3dgs.settings import PRESETS as D3DGS_PRESETS
from aa4d.methods.d3dgs.settings import D3DGSSettings
from aa4d.methods.d3dgs.settings import Rates as D3DGSRates
from aa4d.methods.settings import Decay
from aa4d.settings.allowed import Count, Share


@dataclass(frozen=True, kw_only=True)
class Rates(D3DGSRates):
    """They fall over the whole run, warm-up included."""

    group_center: Decay = Decay(1e-5, 1e-5)  # [SpeeDe3DGS] model units
    group_turn: Decay = Decay(1e-7, 1e-7)  # [SpeeDe3DGS] radians
    group_shift: Decay = Decay(1e-7, 1e-7)  # [SpeeDe3DGS] model units


@dataclass(frozen=True)
class Pruning:
    """Gaussians go that the training views, at noisy times, are least sensitive to."""

    start: Share = 0.2  # [SpeeDe3DGS] of the run
    every: Share = 0.1  # [SpeeDe3DGS] of the run
    growing: Share = 0.6  # [SpeeDe3DGS] share that goes each time while Gaussians still come
    grown: Share = 0.3  # [SpeeDe3DGS] and afterwards
    noise: bool = True  # [SpeeDe3DGS] a view is asked at a time with the noise of training


@dataclass(frozen=True)
class FlowSettings:
    """GroupFlow: rigid groups of Gaussians, found in what the network has learned, move from then on in its place."""

    start: Share = 0.5  # [SpeeDe3DGS] of the run
    groups: Count = 2048  # [SpeeDe3DGS] at most; each starts from one Gaussian
    samples: Count = 8  # [SpeeDe3DGS] times at which trajectories are compared
    members: Count = 100  # [SpeeDe3DGS] of a group, at most, to which its motion is fitted
    times: Count = 200  # [SpeeDe3DGS] of training views, at most, at which a group has a pose


@dataclass(frozen=True, kw_only=True)
class SpeedeSettings(D3DGSSettings):
    method: ClassVar[str] = "speede"

    rates: Rates = field(default_factory=Rates)
    pruning: Pruning = field(default_factory=Pruning)
    flow: FlowSettings | None = None  # [SpeeDe3DGS] off, as there


# The published shares leave one of twelve of some 130,000 Gaussians; CPU presets hold a tenth of those to begin with.
GENTLE = Pruning(growing=0.3, grown=0.1)
QUICK, STANDARD = D3DGS_PRESETS["quick"], D3DGS_PRESETS["standard"]

PRESETS = {
    "quick": SpeedeSettings(
        preset="quick",
        coarse_iterations=QUICK.coarse_iterations,
        fine_iterations=QUICK.fine_iterations,
        voxel_px=QUICK.voxel_px,
        degree_every=QUICK.degree_every,
        rates=Rates(position=QUICK.rates.position, deformation=QUICK.rates.deformation),
        densification=QUICK.densification,
        model=QUICK.model,
        pruning=GENTLE,
    ),
    "standard": SpeedeSettings(
        preset="standard",
        coarse_iterations=STANDARD.coarse_iterations,
        fine_iterations=STANDARD.fine_iterations,
        voxel_px=STANDARD.voxel_px,
        rates=Rates(position=STANDARD.rates.position, deformation=STANDARD.rates.deformation),
        densification=STANDARD.densification,
        model=STANDARD.model,
        pruning=GENTLE,
    ),
    # D3DGS's rates stop where its 40,000 iterations are at 30,000.
    "paper": SpeedeSettings(
        preset="paper",
        coarse_iterations=3000,
        fine_iterations=27_000,
        rates=Rates(deformation=Decay(8e-4, 7.6e-6)),
    ),
}
