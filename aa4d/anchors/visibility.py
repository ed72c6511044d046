"""Which anchors training asks for a camera's picture."""

from __future__ import annotations

import torch
from torch import Tensor

from aa4d.raster.types import Camera

# An anchor is judged by its centre before the field deforms it (on its trajectory, where it rides on one); its
# Gaussians and its own motion reach beyond it by less than this share of the image's width and height.
MARGIN = 0.2


@torch.no_grad()
def in_view(position: Tensor, camera: Camera, present: Tensor | None = None) -> Tensor:
    """Indices [M] of the centres [N, 3] that project into the image or its margin, in order.

    Args:
        present: [N] bool; the others are in nobody's view.
    """
    x = position @ camera.viewmat[:3, :3].T + camera.viewmat[:3, 3]
    z = x[:, 2]
    pixels = (x @ camera.K.T)[:, :2] / z.clamp_min(camera.near)[:, None]
    size = pixels.new_tensor([camera.width, camera.height])
    inside = ((pixels >= -MARGIN * size) & (pixels <= (1 + MARGIN) * size)).all(1)
    inside &= z > camera.near
    if present is not None:
        inside &= present
    return inside.nonzero()[:, 0]
