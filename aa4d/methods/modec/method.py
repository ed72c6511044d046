"""MoDec-GS as a method: a static stage, then both deformations at once; L1 and D-SSIM."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from aa4d.anchors.densification import Statistics
from aa4d.errors import InputError
from aa4d.field.planes import regularisation
from aa4d.kernels.image_loss import image_loss
from aa4d.methods.anchor_growth import grow_and_prune
from aa4d.methods.anchor_model import initial_places
from aa4d.methods.contract import Beginning, Method, Stage, UnitEdit
from aa4d.methods.modec.model import Config, Modec, blank_model
from aa4d.methods.modec.settings import PRESETS, FieldConfig, ModecSettings, ModelConfig
from aa4d.methods.rendering import Rendered
from aa4d.methods.scene_model import SceneModel
from aa4d.methods.settings import temporal_resolution
from aa4d.methods.tensors import plane_sizes, tensor_of

MAX_INTERVALS = 1000


class ModecMethod(Method[ModecSettings]):
    name = ModecSettings.method
    presets = PRESETS

    def resolved(self, settings: ModecSettings, frames: int) -> ModecSettings:
        def with_rows(field: FieldConfig) -> FieldConfig:
            return replace(field, temporal_resolution=field.temporal_resolution or temporal_resolution(frames))

        s = settings
        return replace(s, global_field=with_rows(s.global_field), local_field=with_rows(s.local_field))

    def stages(self, settings: ModecSettings) -> tuple[Stage, ...]:
        views = settings.views_per_step
        return (
            Stage("coarse", settings.coarse_iterations, draws=0, canonical=True, views_per_step=views),
            Stage("fine", settings.fine_iterations, draws=1, views_per_step=views),
        )

    def initial(self, settings: ModecSettings, beginning: Beginning) -> Modec:
        torch.manual_seed(settings.seed)
        model = Modec(config_of(settings), *initial_places(beginning, settings.voxel_px * beginning.pixel))
        model.set_box(torch.from_numpy(beginning.points).float())
        return model

    def blank(self, settings: ModecSettings, units: int) -> Modec:
        return blank_model(config_of(settings), units)

    def image_loss(self, rendered: Rendered, target: Tensor, settings: ModecSettings) -> tuple[Tensor, Tensor]:
        """L1 + w D-SSIM is (1 + w) times a mean of the two."""
        total = 1 + settings.loss.dssim
        loss, squared_error = image_loss(rendered.rendering.color, target, settings.loss.dssim / total)
        return total * loss, squared_error

    def penalty(self, stage: Stage, model: SceneModel, settings: ModecSettings) -> Tensor | None:
        assert isinstance(model, Modec)
        if stage.canonical:
            return None
        w, total = settings.loss, torch.zeros((), device=model.device)
        if model.gad is not None:
            weights = w.global_smoothness, w.global_time_smoothness, w.global_constancy
            total = total + regularisation(model.gad.field, *weights)
        if model.lgd is not None:
            weights = w.local_smoothness, w.local_time_smoothness, w.local_constancy
            total = total + regularisation(model.lgd.field, *weights)
        return total

    def edit(
        self,
        model: SceneModel,
        statistics: Statistics,
        settings: ModecSettings,
        pixel: float,
        generator: torch.Generator,
    ) -> UnitEdit:
        """Scaffold-GS's rule; a new anchor's gates begin anew."""
        assert isinstance(model, Modec)
        d = settings.densification
        # Statistics count views: as many of an interval's must have shown an anchor as there its iterations.
        by_views = replace(d, interval=d.interval * settings.views_per_step)
        edit = grow_and_prune(model, statistics, by_views, settings.voxel_px * pixel, 0.0, generator)
        if (dynamics := model.anchors.dynamics) is None:
            return edit
        return replace(edit, values=edit.values | {"anchors.dynamics": dynamics.new_zeros(len(edit.parent), 2)})

    def header(self, model: SceneModel) -> dict[str, Any]:
        assert isinstance(model, Modec)
        c = model.config.model
        return {"gad": c.gad, "intervals": c.intervals, "lgd": c.lgd, "gates": c.gates}

    def blank_of_file(self, config: dict[str, Any], tensors: dict[str, Tensor], path: Path) -> Modec:
        """Sizes stand in the tensors' shapes."""
        try:
            gad, intervals, lgd, gates = (config[name] for name in ("gad", "intervals", "lgd", "gates"))
            if type(gad) is not bool or type(gates) is not bool or lgd not in ("gaussians", "anchors", "none"):
                raise ValueError("a switch is wrong")
            if not gad and lgd == "none":
                raise ValueError("nothing moves")
            if type(intervals) is not int or not 1 <= intervals <= MAX_INTERVALS:
                raise ValueError(f"intervals is {intervals}")
            offset = tensor_of(tensors, "anchors.offset", path)
            model = ModelConfig(
                offsets=offset.shape[1],
                feature_dim=tensor_of(tensors, "anchors.feature", path).shape[1],
                decoder_hidden=len(tensor_of(tensors, "decoder.opacity.hidden.bias", path)),
                gad=gad,
                intervals=intervals,
                lgd=lgd,
                gates=gates,
            )
            there = {"gad": gad, "lgd": lgd != "none"}
            global_field, local_field = (
                _field_config(tensors, name, path) if there[name] else FieldConfig(temporal_resolution=1)
                for name in ("gad", "lgd")
            )
            return blank_model(Config(model, global_field, local_field), len(offset))
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise InputError(f"{path}: the header's config is wrong ({error!r}); train the model again") from None

    def check(self, model: SceneModel, path: Path) -> None:
        if model.groups is not None:
            raise InputError(f"{path}: holds rigid groups, on which nothing of method {self.name!r} rides")


def config_of(settings: ModecSettings) -> Config:
    return Config(settings.model, settings.global_field, settings.local_field)


def _field_config(tensors: dict[str, Tensor], name: str, path: Path) -> FieldConfig:
    channels, spatial, temporal = plane_sizes(tensors, f"{name}.field", path)
    return FieldConfig(channels, spatial, temporal, len(tensor_of(tensors, f"{name}.encoder.bias", path)))


METHOD = ModecMethod()
