"""A model as the frames of its capture see it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from aa4d.capture.reader import Capture
from aa4d.capture.schema import PinholeCamera
from aa4d.files import whole_file
from aa4d.methods.model_file import LoadedModel
from aa4d.methods.rendering import exposed, render
from aa4d.raster.types import Camera


def view_of_frame(loaded: LoadedModel, capture: Capture, index: int) -> tuple[float | None, Camera, Tensor]:
    """Time, camera and background, as `render` takes them, where the model is; its own pose, which may be refined."""
    c, frame = capture.camera, loaded.frames[index]
    device = loaded.model.device
    camera = loaded.frame.camera(frame.viewmat, c.K, c.width, c.height, device)
    return None if loaded.is_static else frame.t, camera, torch.tensor(loaded.background, device=device)


def render_frame(loaded: LoadedModel, capture: Capture, index: int) -> NDArray[np.uint8]:
    """The model at the time and pose of a frame: [H, W, 3] 8-bit sRGB, as it would be saved.

    Where exposures were learned, as that frame's camera records it: held-out frames have those of their neighbors.
    """
    return _rendered(loaded, *view_of_frame(loaded, capture, index), loaded.frames[index].exposure)


def render_pose(loaded: LoadedModel, t: float, viewmat: NDArray[np.float64], c: PinholeCamera) -> NDArray[np.uint8]:
    """The model at any time in [0, 1] and from any pose [4, 4], world to camera in metres; as `render_frame`."""
    device = loaded.model.device
    camera = loaded.frame.camera(viewmat, c.K, c.width, c.height, device)
    return _rendered(loaded, None if loaded.is_static else t, camera, torch.tensor(loaded.background, device=device))


def _rendered(
    loaded: LoadedModel,
    t: float | None,
    camera: Camera,
    background: Tensor,
    exposure: NDArray[np.float64] | None = None,
) -> NDArray[np.uint8]:
    with torch.no_grad():
        color = render(loaded.model, t, camera, background).rendering.color
        return as_picture(color if exposure is None else exposed(color, torch.from_numpy(exposure).to(color)))


def as_picture(color: Tensor) -> NDArray[np.uint8]:
    """[H, W, 3] in [0, 1] -> 8 bits."""
    return (color.clamp(0, 1) * 255).round().byte().cpu().numpy()


def as_float(picture: NDArray[np.uint8]) -> Tensor:
    """[H, W, 3] 8 bits -> [0, 1]."""
    return torch.from_numpy(picture).float() / 255


def save_png(path: Path, picture: NDArray[np.uint8]) -> None:
    with whole_file(path) as temporary:
        Image.fromarray(picture).save(temporary, format="PNG")
