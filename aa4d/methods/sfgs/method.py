"""4D-SFGS as a method: a stage in which nothing fades or moves, then all of it. The published code has no first one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from aa4d.anchors.densification import Statistics
from aa4d.errors import InputError
from aa4d.methods.anchor_model import initial_places, loss_with_volume
from aa4d.methods.contract import Beginning, Method, Stage, UnitEdit
from aa4d.methods.rendering import Rendered
from aa4d.methods.scene_model import SceneModel
from aa4d.methods.sfgs.decoding import TimedGaussians
from aa4d.methods.sfgs.growth import grow_and_prune
from aa4d.methods.sfgs.model import Anchors4D, Sfgs, blank_model
from aa4d.methods.sfgs.settings import PRESETS, ModelConfig, SfgsSettings
from aa4d.methods.tensors import tensor_of

LARGEST_BETA = 16


class SfgsMethod(Method[SfgsSettings]):
    name = SfgsSettings.method
    presets = PRESETS

    def resolved(self, settings: SfgsSettings, frames: int) -> SfgsSettings:  # noqa: ARG002, nothing depends on it
        return settings

    def stages(self, settings: SfgsSettings) -> tuple[Stage, ...]:
        # Which moment an anchor belongs to means nothing yet, so that none can grow where one is missing.
        return (
            Stage("coarse", settings.coarse_iterations, draws=0, canonical=True, changes_units=False),
            Stage("fine", settings.fine_iterations, draws=1),
        )

    def initial(self, settings: SfgsSettings, beginning: Beginning) -> Sfgs:
        """Points say nothing of when: anchors are drawn evenly over the clip."""
        torch.manual_seed(settings.seed)
        c, clip_s = settings.model, beginning.seconds or 1.0  # any will do for a single frame
        frame_s = clip_s / max(beginning.frames - 1, 1)
        place, log_scale = initial_places(beginning, settings.voxel_px * beginning.pixel)
        moment = clip_s * torch.rand(len(place), 1)
        position = torch.cat([place, moment], dim=1)
        duration = torch.full_like(moment, frame_s * settings.densification.cell_frames).log()
        log_scale = torch.cat([log_scale[:, :3], duration, log_scale[:, 3:]], dim=1)
        return Sfgs(c, Anchors4D(position, log_scale, c.offsets, c.feature_dim), clip_s, frame_s)

    def blank(self, settings: SfgsSettings, units: int) -> Sfgs:
        return blank_model(settings.model, units)

    def image_loss(self, rendered: Rendered, target: Tensor, settings: SfgsSettings) -> tuple[Tensor, Tensor]:
        return loss_with_volume(rendered, target, settings.loss.dssim, settings.loss.volume)

    def observe(self, statistics: Statistics, rendered: Rendered, views: int, settings: SfgsSettings) -> None:
        """Growing listens to a Gaussian as far as it is there, and more to a short one; pruning does not ask when."""
        gaussians = rendered.gaussians
        assert isinstance(gaussians, TimedGaussians)
        weight = gaussians.fade * gaussians.rate**settings.densification.gamma
        lasting = replace(gaussians, opacities=gaussians.lasting)
        statistics.add(rendered.visible, lasting, rendered.rendering, views, weight)

    def edit(
        self,
        model: SceneModel,
        statistics: Statistics,
        settings: SfgsSettings,
        pixel: float,
        generator: torch.Generator,
    ) -> UnitEdit:
        assert isinstance(model, Sfgs)
        return grow_and_prune(model, statistics, settings.densification, settings.voxel_px * pixel, generator)

    def header(self, model: SceneModel) -> dict[str, Any]:
        assert isinstance(model, Sfgs)
        return {"beta": model.config.beta, "fastest": model.config.fastest}

    def blank_of_file(self, config: dict[str, Any], tensors: dict[str, Tensor], path: Path) -> Sfgs:
        """Sizes stand in the tensors' shapes."""
        try:
            beta, fastest = float(config["beta"]), float(config["fastest"])
            if not (1 <= beta <= LARGEST_BETA and 0 < fastest < float("inf")):
                raise ValueError(f"beta is {beta}, fastest {fastest}")
            offset = tensor_of(tensors, "anchors.offset", path)
            model = ModelConfig(
                offsets=offset.shape[1],
                feature_dim=tensor_of(tensors, "anchors.feature", path).shape[1],
                decoder_hidden=len(tensor_of(tensors, "decoder.opacity.hidden.bias", path)),
                beta=beta,
                fastest=fastest,
            )
            return blank_model(model, len(offset))
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise InputError(f"{path}: the header's config is wrong ({error!r}); train the model again") from None

    def check(self, model: SceneModel, path: Path) -> None:
        assert isinstance(model, Sfgs)
        if not (model.clip_s > 0 and model.frame_s > 0):
            raise InputError(f"{path}: clip_s or frame_s is not above 0; train the model again")


METHOD = SfgsMethod()
