"""4D-GS as a method: a static stage, then the deformation; two views a step, and the L1 loss."""

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
from aa4d.kernels.plane_lookup import PLANES
from aa4d.methods.contract import Beginning, Method, Stage, UnitEdit
from aa4d.methods.fourdgs.model import FourDGS, blank_model
from aa4d.methods.fourdgs.settings import PRESETS, FourDGSSettings, ModelConfig
from aa4d.methods.gaussians.density import clone_and_split
from aa4d.methods.gaussians.harmonics import LARGEST_DEGREE
from aa4d.methods.gaussians.model import initial_rows
from aa4d.methods.rendering import Rendered
from aa4d.methods.scene_model import SceneModel
from aa4d.methods.settings import temporal_resolution
from aa4d.methods.tensors import tensor_of

MAX_LEVELS = 8


class FourDGSMethod(Method[FourDGSSettings]):
    name = FourDGSSettings.method
    presets = PRESETS

    def resolved(self, settings: FourDGSSettings, frames: int) -> FourDGSSettings:
        if settings.model.temporal_resolution is not None:
            return settings
        return replace(settings, model=replace(settings.model, temporal_resolution=temporal_resolution(frames)))

    def stages(self, settings: FourDGSSettings) -> tuple[Stage, ...]:
        views = settings.views_per_step
        return (
            Stage("coarse", settings.coarse_iterations, draws=0, canonical=True, views_per_step=views),
            Stage("fine", settings.fine_iterations, draws=1, views_per_step=views),
        )

    def initial(self, settings: FourDGSSettings, beginning: Beginning) -> FourDGS:
        torch.manual_seed(settings.seed)
        model = FourDGS(settings.model, initial_rows(beginning, settings.voxel_px * beginning.pixel))
        model.set_box(torch.from_numpy(beginning.points).float())
        return model

    def blank(self, settings: FourDGSSettings, units: int) -> FourDGS:
        return blank_model(settings.model, units)

    def begin_step(self, stage: Stage, iteration: int, model: SceneModel, settings: FourDGSSettings) -> None:
        assert isinstance(model, FourDGS)
        done = iteration if stage.canonical else settings.coarse_iterations + iteration
        model.degree.fill_(min(done // settings.degree_every, LARGEST_DEGREE))

    def image_loss(self, rendered: Rendered, target: Tensor, settings: FourDGSSettings) -> tuple[Tensor, Tensor]:
        return image_loss(rendered.rendering.color, target, settings.loss.dssim)

    def penalty(self, stage: Stage, model: SceneModel, settings: FourDGSSettings) -> Tensor | None:
        assert isinstance(model, FourDGS)
        if stage.canonical:
            return None
        w = settings.loss
        return regularisation(model.field, w.plane_smoothness, w.time_smoothness, w.time_constancy)

    def edit(
        self,
        model: SceneModel,
        statistics: Statistics,
        settings: FourDGSSettings,
        pixel: float,  # noqa: ARG002, its sizes are shares of the scene's depth
        generator: torch.Generator,
    ) -> UnitEdit:
        assert isinstance(model, FourDGS)
        return clone_and_split(model, statistics, settings.densification, generator)

    def header(self, model: SceneModel) -> dict[str, Any]:
        assert isinstance(model, FourDGS)
        return {"plane_dim": model.config.plane_dim, "levels": model.field.levels, "width": model.config.width}

    def blank_of_file(self, config: dict[str, Any], tensors: dict[str, Tensor], path: Path) -> FourDGS:
        """Sizes that the header does not state stand in the tensors' shapes."""
        try:
            levels = int(config["levels"])
            if not 1 <= levels <= MAX_LEVELS:
                raise ValueError(f"levels is {levels}")
            rows_of = [
                {plane: tensor_of(tensors, f"field.planes.{level}.{plane}", path).shape for plane in PLANES}
                for level in range(levels)
            ]
            sizes = ModelConfig(
                plane_dim=rows_of[0]["xt"][2],
                spatial_resolutions=tuple(rows["xt"][1] for rows in rows_of),
                temporal_resolution=rows_of[0]["xt"][0],
                width=len(tensor_of(tensors, "encoder.bias", path)),
            )
            if (sizes.plane_dim, sizes.width) != (config["plane_dim"], config["width"]):
                raise ValueError("its sizes are not those of the tensors")
            return blank_model(sizes, len(tensor_of(tensors, "free.position", path)))
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise InputError(f"{path}: the header's config is wrong ({error!r}); train the model again") from None

    def check(self, model: SceneModel, path: Path) -> None:
        assert isinstance(model, FourDGS)
        if not 0 <= int(model.degree) <= LARGEST_DEGREE:
            raise InputError(f"{path}: degree is {int(model.degree)}, expected 0 to {LARGEST_DEGREE}; train it again")


METHOD = FourDGSMethod()
