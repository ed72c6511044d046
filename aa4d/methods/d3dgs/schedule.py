"""What D3DGS does by the iterations of the whole run: stages, degrees, time noise, resets of opacity."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from aa4d.methods.contract import Stage, UnitEdit
from aa4d.methods.d3dgs.settings import Growth, ScheduledSettings, TimeNoise
from aa4d.methods.gaussians.model import GaussianModel

RESET_OPACITY = 0.01


def stages(settings: ScheduledSettings) -> tuple[Stage, ...]:
    """The warm-up and the rest; learning rates fall over both."""
    warm_up, rest = settings.coarse_iterations, settings.fine_iterations
    share = warm_up / (warm_up + rest)
    return (
        Stage("coarse", warm_up, draws=0, canonical=True, decay=(0.0, share)),
        Stage("fine", rest, draws=1, decay=(share, 1.0)),
    )


def before(stage: Stage, stages: tuple[Stage, ...]) -> int:
    """Iterations of the run before one of its stages."""
    return sum(other.iterations for other in stages[: stages.index(stage)])


def noise_scale(noise: TimeNoise, done: int, total: int) -> float:
    """The factor of the time noise after `done` of `total` iterations: it falls linearly to zero."""
    end = noise.until * total
    return noise.initial * (1 - done / end) if done < end else 0.0


def noisy_time(t: float, deviation: float, draw: tuple[int, ...]) -> float:
    """t with noise of a standard deviation, the same whenever it is asked for with the same `draw`."""
    return t + deviation * float(np.random.default_rng(draw).standard_normal()) if deviation > 0 else t


def outgrown(model: GaussianModel, growth: Growth, *, was_reset: bool) -> Tensor:
    """[N] bool: Gaussians that go when others have come, transparent or, once opacities were reset, too large."""
    rows = model.free.rows()
    gone = rows.opacity.sigmoid() < growth.min_opacity
    return gone | (rows.log_scale.exp().amax(1) > growth.largest_scale) if was_reset else gone


def keeping(keep: Tensor) -> UnitEdit | None:
    """The edit that lets all but keep [N] bool go; None where all stay, or none would."""
    if bool(keep.all()) or not bool(keep.any()):
        return None
    rows = keep.nonzero()[:, 0]
    return UnitEdit(rows, rows[:0])


def reset_opacity(model: GaussianModel) -> UnitEdit:
    """No opacity stays above 0.01."""
    opacity = model.free.rows().opacity.detach()
    everyone = torch.arange(len(opacity), device=opacity.device)
    bound = math.log(RESET_OPACITY / (1 - RESET_OPACITY))
    return UnitEdit(everyone, everyone[:0], anew={"free.opacity": opacity.clamp_max(bound)})
