"""AdaAnchor4D as a method: coarse stage, DACW, fine stage (paper, sections 4.4 and 5.1)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from aa4d.anchors.canonical import Anchors
from aa4d.anchors.densification import Statistics
from aa4d.field.planes import regularisation
from aa4d.methods.adaanchor4d import files
from aa4d.methods.adaanchor4d.model import AdaAnchor4D, blank_model, embeddings_of
from aa4d.methods.adaanchor4d.settings import PRESETS, AdaAnchor4DSettings
from aa4d.methods.adaanchor4d.warping import density_adaptive_boundaries
from aa4d.methods.anchor_growth import grow_and_prune
from aa4d.methods.anchor_model import initial_places, loss_with_volume
from aa4d.methods.contract import Beginning, Method, Stage, UnitEdit
from aa4d.methods.rendering import Rendered
from aa4d.methods.scene_model import SceneModel
from aa4d.methods.settings import temporal_resolution


class AdaAnchor4DMethod(Method[AdaAnchor4DSettings]):
    name = AdaAnchor4DSettings.method
    presets = PRESETS

    def resolved(self, settings: AdaAnchor4DSettings, frames: int) -> AdaAnchor4DSettings:
        if settings.model.temporal_resolution is not None:
            return settings
        return replace(settings, model=replace(settings.model, temporal_resolution=temporal_resolution(frames)))

    def stages(self, settings: AdaAnchor4DSettings) -> tuple[Stage, ...]:
        return (
            Stage("coarse", settings.coarse_iterations, draws=0, canonical=True),
            Stage("fine", settings.fine_iterations, draws=1),
        )

    def initial(self, settings: AdaAnchor4DSettings, beginning: Beginning) -> AdaAnchor4D:
        # The anchors' draws depend on the variant; the networks' start anew.
        torch.manual_seed(settings.seed)
        c = settings.model
        anchors = Anchors(
            *initial_places(beginning, settings.voxel_px * beginning.pixel),
            c.offsets,
            c.feature_dim,
            c.embedding_dim,
            embeddings=embeddings_of(c),
            embedding_std=settings.embedding_std,
        )
        torch.manual_seed(settings.seed)
        return AdaAnchor4D(c, anchors)

    def blank(self, settings: AdaAnchor4DSettings, units: int) -> AdaAnchor4D:
        return blank_model(settings.model, units)

    def enter(self, stage: Stage, model: SceneModel, settings: AdaAnchor4DSettings) -> None:
        """Build DACW and the field's box from the anchors of the coarse stage."""
        assert isinstance(model, AdaAnchor4D)
        if stage.canonical:
            return
        c, w, position = settings.model, settings.warp, model.anchors.position
        model.field.box.copy_(torch.stack([position.amin(0), position.amax(0)]))
        if c.dacw:
            u = model.field.normalise(position)
            model.warp.boundaries.copy_(
                density_adaptive_boundaries(u, c.bins, w.smoothing, w.gamma, w.lambda_min, w.lambda_max)
            )

    def image_loss(self, rendered: Rendered, target: Tensor, settings: AdaAnchor4DSettings) -> tuple[Tensor, Tensor]:
        return loss_with_volume(rendered, target, settings.loss.dssim, settings.loss.volume)

    def penalty(self, stage: Stage, model: SceneModel, settings: AdaAnchor4DSettings) -> Tensor | None:
        assert isinstance(model, AdaAnchor4D)
        if stage.canonical:
            return None
        # Where anchors ride, the settings of motion say how calm the field is.
        time = (settings.motion if model.groups is not None else None) or settings.loss
        return regularisation(model.field, settings.loss.plane_smoothness, time.time_smoothness, time.time_constancy)

    def edit(
        self,
        model: SceneModel,
        statistics: Statistics,
        settings: AdaAnchor4DSettings,
        pixel: float,
        generator: torch.Generator,
    ) -> UnitEdit:
        assert isinstance(model, AdaAnchor4D)
        group_voxel = 0.0 if settings.motion is None else settings.motion.voxel_px * pixel
        return grow_and_prune(
            model, statistics, settings.densification, settings.voxel_px * pixel, group_voxel, generator
        )

    def header(self, model: SceneModel) -> dict[str, Any]:
        assert isinstance(model, AdaAnchor4D)
        return files.header(model.config)

    def blank_of_file(self, config: dict[str, Any], tensors: dict[str, Tensor], path: Path) -> AdaAnchor4D:
        return files.blank_of_file(config, tensors, path)

    def file_name(self, name: str) -> str:
        return files.file_name_of(name)

    def to_file(self, name: str, value: Tensor) -> Tensor:
        return files.as_in_file(name, value)

    def from_file(self, name: str, value: Tensor) -> Tensor:
        return files.as_in_model(name, value)

    def check(self, model: SceneModel, path: Path) -> None:
        assert isinstance(model, AdaAnchor4D)
        files.check(model, path)


METHOD = AdaAnchor4DMethod()
