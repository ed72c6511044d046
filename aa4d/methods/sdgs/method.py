"""SD-GS as a method: a static stage, then deformation, whose size decides whose gradients count for growing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from aa4d.anchors.densification import Statistics
from aa4d.errors import InputError
from aa4d.field.planes import regularisation
from aa4d.methods.anchor_growth import grow_and_prune
from aa4d.methods.anchor_model import initial_places, loss_with_volume
from aa4d.methods.contract import Beginning, Method, Stage, UnitEdit
from aa4d.methods.rendering import Rendered
from aa4d.methods.scene_model import SceneModel
from aa4d.methods.sdgs.model import DeformedGaussians, Sdgs, blank_model
from aa4d.methods.sdgs.settings import PRESETS, Growth, ModelConfig, SdgsSettings
from aa4d.methods.settings import temporal_resolution
from aa4d.methods.tensors import plane_sizes, tensor_of

MAX_FREQUENCIES = 16


class SdgsMethod(Method[SdgsSettings]):
    name = SdgsSettings.method
    presets = PRESETS

    def resolved(self, settings: SdgsSettings, frames: int) -> SdgsSettings:
        if settings.model.temporal_resolution is not None:
            return settings
        return replace(settings, model=replace(settings.model, temporal_resolution=temporal_resolution(frames)))

    def stages(self, settings: SdgsSettings) -> tuple[Stage, ...]:
        return (
            Stage("coarse", settings.coarse_iterations, draws=0, canonical=True),
            Stage("fine", settings.fine_iterations, draws=1),
        )

    def initial(self, settings: SdgsSettings, beginning: Beginning) -> Sdgs:
        torch.manual_seed(settings.seed)
        return Sdgs(settings.model, *initial_places(beginning, settings.voxel_px * beginning.pixel))

    def blank(self, settings: SdgsSettings, units: int) -> Sdgs:
        return blank_model(settings.model, units)

    def enter(self, stage: Stage, model: SceneModel, settings: SdgsSettings) -> None:  # noqa: ARG002
        """The planes cover the anchors of the static stage."""
        assert isinstance(model, Sdgs)
        if not stage.canonical:
            position = model.anchors.position
            model.deformation.field.box.copy_(torch.stack([position.amin(0), position.amax(0)]))

    def image_loss(self, rendered: Rendered, target: Tensor, settings: SdgsSettings) -> tuple[Tensor, Tensor]:
        return loss_with_volume(rendered, target, settings.loss.dssim, settings.loss.volume)

    def penalty(self, stage: Stage, model: SceneModel, settings: SdgsSettings) -> Tensor | None:
        assert isinstance(model, Sdgs)
        w = settings.loss
        if stage.canonical:
            return None
        return regularisation(model.deformation.field, w.plane_smoothness, w.time_smoothness, w.time_constancy)

    def observe(self, statistics: Statistics, rendered: Rendered, views: int, settings: SdgsSettings) -> None:
        """Growing listens to an anchor as far as it deforms."""
        gaussians, weight = rendered.gaussians, None
        if isinstance(gaussians, DeformedGaussians):
            per_unit = statistics.drawn.shape[1]
            weight = weight_of(gaussians.moved, gaussians.scaled, settings.densification).repeat_interleave(per_unit)
        statistics.add(rendered.visible, gaussians, rendered.rendering, views, weight)

    def edit(
        self,
        model: SceneModel,
        statistics: Statistics,
        settings: SdgsSettings,
        pixel: float,
        generator: torch.Generator,
    ) -> UnitEdit:
        assert isinstance(model, Sdgs)
        return grow_and_prune(model, statistics, settings.densification, settings.voxel_px * pixel, 0.0, generator)

    def header(self, model: SceneModel) -> dict[str, Any]:
        assert isinstance(model, Sdgs)
        return {"time_frequencies": model.config.time_frequencies}

    def blank_of_file(self, config: dict[str, Any], tensors: dict[str, Tensor], path: Path) -> Sdgs:
        """Sizes stand in the tensors' shapes."""
        try:
            frequencies = config["time_frequencies"]
            if type(frequencies) is not int or not 1 <= frequencies <= MAX_FREQUENCIES:
                raise ValueError(f"time_frequencies is {frequencies}")
            channels, spatial, temporal = plane_sizes(tensors, "deformation.field", path)
            offset = tensor_of(tensors, "anchors.offset", path)
            model = ModelConfig(
                offsets=offset.shape[1],
                feature_dim=tensor_of(tensors, "anchors.feature", path).shape[1],
                decoder_hidden=len(tensor_of(tensors, "decoder.opacity.hidden.bias", path)),
                time_frequencies=frequencies,
                plane_dim=channels,
                spatial_resolutions=spatial,
                temporal_resolution=temporal,
                width=len(tensor_of(tensors, "deformation.encoder.bias", path)),
            )
            return blank_model(model, len(offset))
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise InputError(f"{path}: the header's config is wrong ({error!r}); train the model again") from None

    def check(self, model: SceneModel, path: Path) -> None:
        if model.groups is not None:
            raise InputError(f"{path}: holds rigid groups, on which nothing of method {self.name!r} rides")


def weight_of(moved: Tensor, scaled: Tensor, settings: Growth) -> Tensor:
    """[M] how much the gradients of anchors count that have moved and scaled [M] so far in a view.

    Either change is a share of its percentile over the view; their weighted sum has a mean of 1, so that a view counts
    as one wherever the statistics ask how often something was drawn. 1 each where nothing changes.
    """
    weight = torch.zeros_like(moved)
    for change, factor in ((moved, settings.by_place), (scaled, settings.by_scale)):
        reference = torch.quantile(change, settings.percentile) if len(change) else change.new_zeros(())
        weight = weight + factor * torch.where(reference > 0, change / reference.clamp_min(1e-30), change)
    mean = weight.mean() if len(weight) else weight.new_zeros(())
    return torch.where(mean > 0, weight / mean.clamp_min(1e-30), torch.ones_like(weight))


METHOD = SdgsMethod()
