"""Motion of what a model draws from one frame to another: its Gaussians' motion, drawn with them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from aa4d.capture.reader import Capture
from aa4d.evaluation.views import view_of_frame
from aa4d.filming.layers import NOTHING
from aa4d.methods.model_file import LoadedModel
from aa4d.raster import rasterize
from aa4d.raster.types import Camera


@dataclass(frozen=True)
class DrawnMotion:
    """Motion of the pixels of a frame to another; each the mean over what the pixel shows, weighted by color."""

    flow_px: NDArray[np.float64]  # [H, W, 2] x right, y down
    displacement_m: NDArray[np.float64]  # [H, W, 3]
    shown: NDArray[np.bool_]  # [H, W] whether anything is drawn there; elsewhere both motions are 0


def drawn_motion(loaded: LoadedModel, capture: Capture, start: int, end: int) -> DrawnMotion:
    """From frame `start` to frame `end` of the capture, each at its time and by the camera that the model has for it.

    The Gaussians that are drawn at `start` are decoded at the time of `end` as well. The difference of their projected
    centres (the same projection for both, each by its own camera), and of the centres themselves, is drawn as features
    and divided by the alpha.
    """
    model = loaded.model
    t, camera, background = view_of_frame(loaded, capture, start)
    t_end, camera_end, _ = view_of_frame(loaded, capture, end)
    with torch.no_grad():
        visible = model.visible(t, camera)
        now = model.gaussians(t, camera, visible)
        then = model.gaussians(t_end, camera_end, visible)
        moved = _project(then.means, camera_end) - _project(now.means, camera)
        features = torch.cat([moved, (then.means - now.means) * loaded.frame.unit_m], dim=1)
        rendering = rasterize(replace(now, features=features), camera, background=background)
        assert rendering.features is not None
        shown = rendering.alpha >= NOTHING
        mean = torch.where(shown[..., None], rendering.features / rendering.alpha.clamp_min(NOTHING)[..., None], 0)
    values = mean.double().cpu().numpy()
    return DrawnMotion(values[..., :2], values[..., 2:], shown.cpu().numpy())


def _project(means: Tensor, camera: Camera) -> Tensor:
    """[N, 3] -> [N, 2] pixels; what is nearer than the camera's near plane counts as on it."""
    in_camera = means @ camera.viewmat[:3, :3].T + camera.viewmat[:3, 3]
    pixels = in_camera @ camera.K.T
    return pixels[:, :2] / in_camera[:, 2:].clamp_min(camera.near)
