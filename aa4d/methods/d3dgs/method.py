"""D3DGS as a method: a static warm-up, then the deformation, with noise on time that goes away."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import torch
from torch import Tensor

from aa4d.anchors.densification import Statistics
from aa4d.errors import InputError
from aa4d.kernels.image_loss import image_loss
from aa4d.methods.contract import Beginning, Looks, Method, Stage, UnitEdit
from aa4d.methods.d3dgs import schedule
from aa4d.methods.d3dgs.model import D3DGS
from aa4d.methods.d3dgs.settings import PRESETS, D3DGSSettings, ModelConfig, ScheduledSettings
from aa4d.methods.gaussians.density import clone_and_split
from aa4d.methods.gaussians.harmonics import LARGEST_DEGREE
from aa4d.methods.gaussians.model import GaussianModel, blank_rows, initial_rows
from aa4d.methods.rendering import Rendered
from aa4d.methods.scene_model import SceneModel
from aa4d.methods.tensors import tensor_of
from aa4d.raster.types import Output

LARGEST_DEPTH = 64  # layers
SIZES = [f.name for f in fields(ModelConfig) if f.name != "still_start"]

S = TypeVar("S", bound=ScheduledSettings)


class DeformedByNetwork(Method[S]):
    """How free Gaussians learn that a network deforms: D3DGS, and what its code was continued into."""

    def resolved(self, settings: S, frames: int) -> S:  # noqa: ARG002, nothing depends on it
        return settings

    def stages(self, settings: S) -> tuple[Stage, ...]:
        return schedule.stages(settings)

    def done_of_run(self, stage: Stage, done: int, settings: S) -> int:
        """Iterations of the whole run, where `done` of a stage are done."""
        return schedule.before(stage, self.stages(settings)) + done

    def begin_step(self, stage: Stage, iteration: int, model: SceneModel, settings: S) -> None:
        assert isinstance(model, GaussianModel)
        done = self.done_of_run(stage, iteration, settings)
        model.degree.fill_(min(done // settings.degree_every, LARGEST_DEGREE))

    def trained_time(self, stage: Stage, iteration: int, t: float, views: int, settings: S) -> float:
        """With D3DGS's annealed noise.

        The interval is that of all views, as its paper has it; its code divides by the views that are left of the
        epoch, so that the last view of each is drawn with noise of a tenth of the clip.
        """
        if stage.canonical:
            return t
        total = settings.coarse_iterations + settings.fine_iterations
        scale = schedule.noise_scale(settings.noise, self.done_of_run(stage, iteration, settings), total)
        return schedule.noisy_time(t, scale / views, (settings.seed, stage.draws, iteration))

    def outputs(self, settings: S) -> Collection[Output]:
        asked: tuple[Output, ...] = ("absolute_gradient",)
        return asked if settings.densification.absolute else ()

    def image_loss(self, rendered: Rendered, target: Tensor, settings: S) -> tuple[Tensor, Tensor]:
        return image_loss(rendered.rendering.color, target, settings.loss.dssim)

    def edit(
        self,
        model: SceneModel,
        statistics: Statistics,
        settings: S,
        pixel: float,  # noqa: ARG002, its sizes are shares of the scene's depth
        generator: torch.Generator,
    ) -> UnitEdit:
        assert isinstance(model, GaussianModel)
        return clone_and_split(model, statistics, settings.densification, generator)

    @torch.no_grad()
    def revise(
        self,
        stage: Stage,
        done: int,
        model: SceneModel,
        settings: S,
        looks: Looks,  # noqa: ARG002, it looks at no picture
    ) -> UnitEdit | None:
        """Pruning with growth, and resets of opacity.

        A reset comes one iteration after D3DGS's: a stage must not end with a scene that was just made transparent.
        """
        assert isinstance(model, GaussianModel)
        g, total = settings.densification, self.done_of_run(stage, done, settings)
        if not stage.changes_units or done > g.until:
            return None
        if g.reset_every and total > 1 and (total - 1) % g.reset_every == 0:
            return schedule.reset_opacity(model)
        if done > g.start and done % g.interval == 0:
            was_reset = 0 < g.reset_every < total
            return schedule.keeping(~schedule.outgrown(model, g, was_reset=was_reset))
        return None


class D3DGSMethod(DeformedByNetwork[D3DGSSettings]):
    name = D3DGSSettings.method
    presets = PRESETS

    def initial(self, settings: D3DGSSettings, beginning: Beginning) -> D3DGS:
        torch.manual_seed(settings.seed)
        return D3DGS(settings.model, initial_rows(beginning, settings.voxel_px * beginning.pixel))

    def blank(self, settings: D3DGSSettings, units: int) -> D3DGS:
        return D3DGS(settings.model, blank_rows(units))

    def header(self, model: SceneModel) -> dict[str, Any]:
        assert isinstance(model, D3DGS)
        return sizes_in(model)

    def blank_of_file(self, config: dict[str, Any], tensors: dict[str, Tensor], path: Path) -> D3DGS:
        return D3DGS(sizes_of(config, path), blank_rows(len(tensor_of(tensors, "free.position", path))))


def sizes_in(model: D3DGS) -> dict[str, int]:
    """What `sizes_of` asks a header for."""
    return {name: getattr(model.config, name) for name in SIZES}


def sizes_of(config: dict[str, Any], path: Path) -> ModelConfig:
    """The network of a file's header. Raises InputError for sizes that no training writes."""
    try:
        sizes = {name: config[name] for name in SIZES}
        if not all(type(size) is int and 1 <= size <= 2048 for size in sizes.values()):
            raise ValueError(f"sizes are {sizes}")
        if sizes["depth"] > LARGEST_DEPTH or max(sizes["place_frequencies"], sizes["time_frequencies"]) > LARGEST_DEPTH:
            raise ValueError(f"sizes are {sizes}, over {LARGEST_DEPTH} layers or octaves")
        return ModelConfig(**sizes)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: the header's config is wrong ({error!r}); train the model again") from None


METHOD = D3DGSMethod()
