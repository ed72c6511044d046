"""A model as the frames of its capture see it."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from aa4d.capture.reader import Capture
from aa4d.methods.model_file import LoadedModel
from aa4d.methods.rendering import render
from aa4d.raster.types import Camera


def view_of_frame(loaded: LoadedModel, capture: Capture, index: int) -> tuple[float | None, Camera, Tensor]:
    """Time, camera and background, as `render` takes them, where the model is; its own pose, which may be refined."""
    c, frame = capture.camera, loaded.frames[index]
    device = loaded.model.device
    camera = loaded.frame.camera(frame.viewmat, c.K, c.width, c.height, device)
    return None if loaded.is_static else frame.t, camera, torch.tensor(loaded.background, device=device)


def render_frame(loaded: LoadedModel, capture: Capture, index: int) -> NDArray[np.uint8]:
    """The model at the time and pose of a frame: [H, W, 3] 8-bit sRGB, as it would be saved."""
    with torch.no_grad():
        return as_picture(render(loaded.model, *view_of_frame(loaded, capture, index)).rendering.color)


def as_picture(color: Tensor) -> NDArray[np.uint8]:
    """[H, W, 3] in [0, 1] -> 8 bits."""
    return (color.clamp(0, 1) * 255).round().byte().cpu().numpy()
