"""The trained model that panels of export and playback begin with."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from aa4d.cost.inputs import scaled, trained
from aa4d.cost.panel import Setup
from aa4d.cost.training import base
from aa4d.graph.task import Task

if TYPE_CHECKING:
    from torch import Tensor

    from aa4d.export.clip import Clip


def usual_run(setup: Setup) -> Task:
    """The training that varies nothing."""
    return trained(setup, "usual", base(setup), scaled(setup, setup.size.share))


def clip_of(run: Path, views: int) -> Clip:
    """So many of the frames of a run's capture, evenly."""
    from aa4d.export.clip import Clip
    from aa4d.filming.camera_path import path_of_frames, resampled
    from aa4d.methods.model_file import load_model

    loaded = load_model(run / "model.safetensors")
    return Clip(loaded, resampled(path_of_frames(loaded, "all"), views), None)


def drawn(clip: Clip, index: int, values: dict[str, Any]) -> Tensor:
    """The picture [H, W, 3] of a view, of Gaussians as exporters have them (aa4d/export/keys.py)."""
    import numpy as np
    import torch

    from aa4d.raster import Camera, Gaussians, rasterize

    def tensor(array: Any) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(array, np.float32))

    camera, view = clip.path.camera, clip.path.views[index]
    gaussians = Gaussians(
        tensor(values["position"]),
        tensor(values["rotation"]),
        tensor(np.exp(values["log_scale"])),
        tensor(values["opacity"][:, 0]),
        tensor(values["color"]),
    )
    seen = Camera(tensor(view.viewmat), tensor(camera.K), camera.width, camera.height)
    background = tensor(clip.loaded.background)
    return rasterize(gaussians, seen, background=background).color.clamp(0, 1)
