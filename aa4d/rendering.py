"""The complete rendering pipeline: choose, deform, decode, rasterise."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

from torch import Tensor

from aa4d.anchors.visibility import in_view
from aa4d.model import AdaAnchor4D
from aa4d.raster import rasterize
from aa4d.raster.types import Camera, Gaussians, Output, Rendering


@dataclass(frozen=True)
class Rendered:
    rendering: Rendering
    gaussians: Gaussians  # K for each visible anchor
    visible: Tensor  # [M] the anchors that were deformed and decoded


def render(
    model: AdaAnchor4D,
    t: float | None,
    camera: Camera,
    background: Tensor,
    *,
    outputs: Collection[Output] = (),
    anchor_features: Tensor | None = None,
) -> Rendered:
    """One image at time t in [0, 1], or of the canonical scene at t = None; `camera` stands in the model frame.

    Args:
        outputs: what the rasteriser is asked for besides.
        anchor_features: [N, F] anything to draw with the anchors, F at most 32: it becomes `Rendering.features`.
    """
    visible = in_view(model.resting(t), camera, model.present(t))
    gaussians = model.gaussians(t, camera, visible)
    if anchor_features is not None:
        offsets = model.anchors.offset.shape[1]
        gaussians = replace(gaussians, features=anchor_features[visible].repeat_interleave(offsets, 0))
    return Rendered(rasterize(gaussians, camera, background=background, outputs=outputs), gaussians, visible)
