"""MoDec-GS: global anchor deformation by intervals of time, decoding, local Gaussian deformation at each time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor, nn

from aa4d.anchors.canonical import AnchorRows, Anchors
from aa4d.anchors.decoding import AnchorState, Decoder
from aa4d.field.planes import FeaturePlanes
from aa4d.methods.anchor_model import AnchorModel
from aa4d.methods.modec.deformation import AnchorDeformation, Deformation, GaussianDeformation, start_of_interval
from aa4d.methods.modec.settings import FieldConfig, ModelConfig
from aa4d.raster.types import Camera, Gaussians


@dataclass(frozen=True)
class Config:
    """All that a model's shapes follow from."""

    model: ModelConfig
    global_field: FieldConfig
    local_field: FieldConfig

    @property
    def gated(self) -> bool:
        """Whether anchors own logits of gates: they deform, and the gates are on."""
        return self.model.gates and (self.model.gad or self.model.lgd == "anchors")


class Modec(AnchorModel):
    """A deformation that is switched off is None, and has no tensors."""

    gad: AnchorDeformation | None
    lgd: Deformation | None

    def __init__(self, config: Config, position: Tensor, log_scale: Tensor) -> None:
        """Positions [N, 3] and log scales [N, 6] of the anchors."""
        c = config.model
        owned = ("dynamics",) if config.gated else ()
        anchors = Anchors(position, log_scale, c.offsets, c.feature_dim, 2, embeddings=owned)
        super().__init__(anchors, Decoder(c.feature_dim, c.offsets, c.decoder_hidden))
        self.config = config
        self.gad = AnchorDeformation(config.global_field, c) if c.gad else None
        local = {"gaussians": GaussianDeformation, "anchors": AnchorDeformation}.get(c.lgd)
        self.lgd = local(config.local_field, c) if local is not None else None

    def deformations(self) -> list[Deformation]:
        return [deformation for deformation in (self.gad, self.lgd) if deformation is not None]

    def fields(self) -> list[FeaturePlanes]:
        return [deformation.field for deformation in self.deformations()]

    def parameter_groups(self, *, canonical: bool) -> dict[str, list[nn.Parameter]]:
        groups = self.static_groups()
        if canonical:
            return groups
        if self.anchors.dynamics is not None:
            groups["dynamics"] = [self.anchors.dynamics]
        groups |= {"planes": [], "geometry": [], "deformation": []}
        for deformation in self.deformations():
            for name, parameter in deformation.named_parameters():
                of_anchors = isinstance(deformation, AnchorDeformation)
                part = name.partition(".")[0]
                geometry = of_anchors and part in ("head_offset", "head_scale")
                groups["planes" if part == "field" else "geometry" if geometry else "deformation"].append(parameter)
        return {name: parameters for name, parameters in groups.items() if parameters}

    def deformed(self, a: AnchorRows, t: float) -> AnchorState:
        state = self.canonical(a)
        if self.gad is not None:
            state = self.gad(state, a.dynamics, start_of_interval(t, self.config.model.intervals))
        if isinstance(self.lgd, AnchorDeformation):
            state = self.lgd(state, a.dynamics, t)
        return state

    def gaussians(self, t: float | None, camera: Camera, visible: Tensor | None = None) -> Gaussians:
        gaussians = super().gaussians(t, camera, visible)
        if t is None:
            return gaussians
        if isinstance(self.lgd, GaussianDeformation):
            gaussians = self.lgd(gaussians, t)
        return replace(gaussians, scales=gaussians.scales.abs())

    def centers(self, t: float | None) -> Tensor:
        """As of every method of anchors; an anchor goes along with what the local field does to the place it is at."""
        centers = super().centers(t)
        if t is None or not isinstance(self.lgd, GaussianDeformation):
            return centers
        return centers + self.lgd.head_position(self.lgd.features(centers, t))

    def set_box(self, points: Tensor) -> None:
        """The planes cover the points [P, 3] that training begins with."""
        for field in self.fields():
            field.box.copy_(torch.stack([points.amin(0), points.amax(0)]))


def blank_model(config: Config, anchors: int) -> Modec:
    """A model of the right shapes, to load a state into."""
    return Modec(config, torch.zeros(anchors, 3), torch.zeros(anchors, 6))
