"""SpeeDe3DGS as a method: D3DGS, pruned by sensitivity while and after it grows, then in groups where that is asked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from aa4d.errors import InputError
from aa4d.methods.contract import Beginning, Looks, Stage, UnitEdit
from aa4d.methods.d3dgs import schedule
from aa4d.methods.d3dgs.method import DeformedByNetwork, sizes_in, sizes_of
from aa4d.methods.gaussians.model import blank_rows, initial_rows
from aa4d.methods.scene_model import SceneModel
from aa4d.methods.speede.model import Speede
from aa4d.methods.speede.sensitivity import most_sensitive, sensitivities
from aa4d.methods.speede.settings import PRESETS, SpeedeSettings
from aa4d.methods.tensors import tensor_of

FLOW = "flow"


class SpeedeMethod(DeformedByNetwork[SpeedeSettings]):
    name = SpeedeSettings.method
    presets = PRESETS

    def stages(self, settings: SpeedeSettings) -> tuple[Stage, ...]:
        """D3DGS's; with groups the last one is divided where they begin."""
        coarse, fine = super().stages(settings)
        if settings.flow is None or fine.iterations < 2:
            return coarse, fine
        total = coarse.iterations + fine.iterations
        before = min(max(round(settings.flow.start * total) - coarse.iterations, 1), fine.iterations - 1)
        share = (coarse.iterations + before) / total
        return (
            coarse,
            replace(fine, iterations=before, decay=(fine.decay[0], share)),
            Stage(FLOW, fine.iterations - before, draws=2, changes_units=False, decay=(share, 1.0)),
        )

    def initial(self, settings: SpeedeSettings, beginning: Beginning) -> Speede:
        torch.manual_seed(settings.seed)
        rows = initial_rows(beginning, settings.voxel_px * beginning.pixel)
        return Speede(settings.model, rows, grouped=settings.flow is not None, times=beginning.times)

    def blank(self, settings: SpeedeSettings, units: int) -> Speede:
        return Speede(settings.model, blank_rows(units), grouped=settings.flow is not None)

    def enter(self, stage: Stage, model: SceneModel, settings: SpeedeSettings) -> None:
        if stage.name == FLOW:
            assert isinstance(model, Speede)
            assert settings.flow is not None
            model.begin_flow(settings.flow)

    @torch.no_grad()
    def revise(
        self, stage: Stage, done: int, model: SceneModel, settings: SpeedeSettings, looks: Looks
    ) -> UnitEdit | None:
        """D3DGS's, and of those that stay the least sensitive go where it is time."""
        assert isinstance(model, Speede)
        edit = super().revise(stage, done, model, settings, looks)
        share = self.pruned_share(stage, done, settings)
        if share is None:
            return edit
        total = settings.coarse_iterations + settings.fine_iterations
        factor = schedule.noise_scale(settings.noise, self.done_of_run(stage, done, settings), total)
        views = looks()
        deviation = factor / len(views) if settings.pruning.noise else 0.0
        asked = [
            replace(look, t=schedule.noisy_time(look.t, deviation, (settings.seed, stage.draws, done, number)))
            for number, look in enumerate(views)
        ]
        rows = torch.arange(len(model), device=model.device) if edit is None else edit.keep
        kept = most_sensitive(sensitivities(model, asked)[rows], share)
        if not bool(kept.any()):
            return edit
        anew = {} if edit is None else {name: value[kept] for name, value in edit.anew.items()}
        return UnitEdit(rows[kept], rows[:0], anew=anew)

    def pruned_share(self, stage: Stage, done: int, settings: SpeedeSettings) -> float | None:
        """Share of the Gaussians that goes after `done` iterations of a stage; None where it is not time."""
        p = settings.pruning
        now, total = self.done_of_run(stage, done, settings), settings.coarse_iterations + settings.fine_iterations
        every = max(round(p.every * total), 1)
        if stage.canonical or now % every or not round(p.start * total) <= now < total:
            return None
        growing = stage.changes_units and done < settings.densification.until
        return p.growing if growing else p.grown

    def header(self, model: SceneModel) -> dict[str, Any]:
        assert isinstance(model, Speede)
        return sizes_in(model) | {"flow": model.flow is not None}

    def blank_of_file(self, config: dict[str, Any], tensors: dict[str, Tensor], path: Path) -> Speede:
        sizes, grouped = sizes_of(config, path), config.get("flow")
        if not isinstance(grouped, bool):
            raise InputError(f"{path}: the header's config is wrong (flow is {grouped!r}); train the model again")
        return Speede(sizes, blank_rows(len(tensor_of(tensors, "free.position", path))), grouped=grouped)

    def check(self, model: SceneModel, path: Path) -> None:
        """Raises InputError for groups that no training writes."""
        assert isinstance(model, Speede)
        if not model.flow:
            return
        flow, label = model.flow, model.label
        poses = (len(flow), max(len(flow.time) - 1, 0), 3)
        if flow.center.shape != (len(flow), 3) or flow.turn.shape != poses or flow.shift.shape != poses:
            raise InputError(f"{path}: the groups' tensors differ in size; train the model again")
        if int(label.min()) < 0 or int(label.max()) >= len(flow):
            raise InputError(f"{path}: label names a group that is not there (has {len(flow)}); train the model again")
        if bool((flow.time.diff() <= 0).any()):
            raise InputError(f"{path}: flow.time goes back; train the model again")


METHOD = SpeedeMethod()
