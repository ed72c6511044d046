"""Speed and size of a model."""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass

import torch

from aa4d.capture.reader import Capture
from aa4d.device import wait_for
from aa4d.evaluation.views import view_of_frame
from aa4d.methods.capabilities import HasEvaluationCache
from aa4d.methods.model_file import LoadedModel
from aa4d.methods.rendering import render
from aa4d.methods.scene_model import SceneModel

WARM_UP_FRAMES = 5
TIMED_FRAMES = 50


@dataclass(frozen=True)
class Speed:
    fps: float
    gaussians: int  # mean number with a positive opacity over the timed frames
    fps_cached: float | None = None  # from the method's evaluation cache; None where it has none
    cache: str | None = None  # what that cache is


def measure_speed(loaded: LoadedModel, capture: Capture) -> Speed:
    """Frames per second of the whole pipeline: choose, deform, decode and rasterise, without any image file.

    The median of `TIMED_FRAMES` frames, each at its own time and pose, after `WARM_UP_FRAMES` that do not count. On a
    device that works asynchronously both ends of a frame wait for it. A second time from the method's cache, if it has
    one; to fill it takes no time here.
    """
    fps, gaussians = _measure(loaded, capture)
    if not isinstance(loaded.model, HasEvaluationCache):
        return Speed(fps, gaussians)
    with torch.no_grad(), loaded.model.cached() as cache:
        return Speed(fps, gaussians, _measure(loaded, capture)[0], cache)


def _measure(loaded: LoadedModel, capture: Capture) -> tuple[float, int]:
    """Frames per second, and the mean number of Gaussians with a positive opacity."""
    seconds, drawn = [], []
    with torch.no_grad():
        for number in range(WARM_UP_FRAMES + TIMED_FRAMES):
            view = view_of_frame(loaded, capture, number % len(capture.frames))
            wait_for(loaded.model.device)
            started = time.perf_counter()
            gaussians = render(loaded.model, *view).gaussians
            wait_for(loaded.model.device)
            elapsed = time.perf_counter() - started
            if number >= WARM_UP_FRAMES:
                seconds.append(elapsed)
                drawn.append(int((gaussians.opacities > 0).sum()))
    return 1 / statistics.median(seconds), round(statistics.fmean(drawn))


def neural_mib(model: SceneModel) -> float:
    """Networks and planes, without what units own, in MiB: the paper's "neural size"."""
    return sum(value.numel() * value.element_size() for value in model.shared_tensors()) / 2**20
