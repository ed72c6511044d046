"""The complete rendering pipeline: choose, deform, decode, rasterise."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

from torch import Tensor

from aa4d.methods.scene_model import SceneModel
from aa4d.raster import rasterize
from aa4d.raster.types import Camera, Gaussians, Output, Rendering


@dataclass(frozen=True)
class Rendered:
    rendering: Rendering
    gaussians: Gaussians  # those of each visible unit together
    visible: Tensor  # [M] the units that were deformed and decoded


def exposed(color: Tensor, exposure: Tensor) -> Tensor:
    """Colors [..., 3] as a camera records them whose exposure is the affine map [3, 4] (M, b): M c + b."""
    return color @ exposure[:, :3].T + exposure[:, 3]


def render(
    model: SceneModel,
    t: float | None,
    camera: Camera,
    background: Tensor,
    *,
    outputs: Collection[Output] = (),
    unit_features: Tensor | None = None,
) -> Rendered:
    """One image at time t in [0, 1], or of the canonical scene at t = None; `camera` stands in the model frame.

    Args:
        outputs: what the rasteriser is asked for besides.
        unit_features: [N, F] anything to draw with the units, F at most 32: it becomes `Rendering.features`.
    """
    visible = model.visible(t, camera)
    gaussians = model.gaussians(t, camera, visible)
    if unit_features is not None:
        gaussians = replace(gaussians, features=unit_features[visible].repeat_interleave(model.per_unit, 0))
    return Rendered(rasterize(gaussians, camera, background=background, outputs=outputs), gaussians, visible)
