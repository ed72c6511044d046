"""SpeeDe3DGS's pruning: a Gaussian's score is how strongly all training views answer to its falloff."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from aa4d.methods.contract import Look
from aa4d.methods.scene_model import SceneModel
from aa4d.raster import rasterize
from aa4d.raster.types import Gaussians, Output

ASKED: tuple[Output, ...] = ("sensitivity",)


def sensitivities(model: SceneModel, looks: Sequence[Look]) -> Tensor:
    """[N] sum over views and pixels of (o dI/d(alpha))^2, I the sum of the pixel's channels.

    The native rasteriser draws, on the CPU, wherever the model is: no other tells squares of single pixels.
    """
    scores = torch.zeros(len(model), device=model.device)
    for look in looks:
        with torch.no_grad():
            visible = model.visible(look.t, look.camera)
            drawn = model.gaussians(look.t, look.camera, visible)
        means, quaternions, scales, opacities, colors = (
            value.detach().cpu()
            for value in (drawn.means, drawn.quaternions, drawn.scales, drawn.opacities, drawn.colors)
        )
        camera = replace(look.camera, viewmat=look.camera.viewmat.cpu(), K=look.camera.K.cpu())
        with torch.enable_grad():
            plain = Gaussians(means, quaternions, scales, opacities.requires_grad_(), colors)
            image = rasterize(plain, camera, background=look.background.cpu(), outputs=ASKED, backend="native")
            image.color.sum().backward()
        assert image.sensitivity is not None
        scores.index_add_(0, visible, image.sensitivity.to(scores.device))
    return scores


def most_sensitive(scores: Tensor, share: float) -> Tensor:
    """[N] bool: those above the score that the lowest `share` ends with; equal ones go with it."""
    last = scores.sort().values[int(share * (len(scores) - 1))]
    return scores > last
