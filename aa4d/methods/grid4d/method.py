"""Grid4D as a method: D3DGS's schedule, and grids whose features are asked to change little from place to place."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from aa4d.errors import InputError
from aa4d.methods.contract import Beginning, Stage
from aa4d.methods.d3dgs.method import DeformedByNetwork
from aa4d.methods.gaussians.model import blank_rows, initial_rows
from aa4d.methods.grid4d.hash_grid import rows_of
from aa4d.methods.grid4d.model import PAIRS, Grid4D, grid_sizes
from aa4d.methods.grid4d.settings import PRESETS, Grid4DSettings, ModelConfig
from aa4d.methods.scene_model import SceneModel
from aa4d.methods.tensors import tensor_of
from aa4d.settings.checking import changed

SIZES = [f.name for f in fields(ModelConfig) if f.name != "still_start"]
CALM = 7  # tells the penalty's draws from others of the same iteration


class Grid4DMethod(DeformedByNetwork[Grid4DSettings]):
    name = Grid4DSettings.method
    presets = PRESETS

    def initial(self, settings: Grid4DSettings, beginning: Beginning) -> Grid4D:
        torch.manual_seed(settings.seed)
        model = Grid4D(settings.model, initial_rows(beginning, settings.voxel_px * beginning.pixel))
        model.set_box(torch.from_numpy(beginning.points).float())
        return model

    def blank(self, settings: Grid4DSettings, units: int) -> Grid4D:
        return Grid4D(settings.model, blank_rows(units))

    def begin_step(self, stage: Stage, iteration: int, model: SceneModel, settings: Grid4DSettings) -> None:
        super().begin_step(stage, iteration, model, settings)
        assert isinstance(model, Grid4D)
        model.iteration = iteration

    def penalty(self, stage: Stage, model: SceneModel, settings: Grid4DSettings) -> Tensor | None:
        """Squared changes of features from some Gaussians' places to others nearby, at one time of the clip.

        Grid4D asks at the time of the view; here it is one drawn anew, for the penalty knows no view.
        """
        assert isinstance(model, Grid4D)
        w = settings.loss
        if stage.canonical or not w.place + w.time > 0:
            return None
        draw = np.random.default_rng((settings.seed, stage.draws, model.iteration, CALM))
        rows = draw.permutation(len(model))[: max(round(w.asked * len(model)), 1)]
        place = model.of_box(model.free.rows(torch.from_numpy(rows).to(model.device)).position)
        away = torch.from_numpy(draw.uniform(-w.nearby, w.nearby, place.shape)).to(place)
        t = float(draw.uniform())

        def change(a: Tensor, b: Tensor) -> Tensor:
            return (a - b).square().sum(1).mean()

        of_place = change(model.place_grid(place + away), model.place_grid(place))
        of_time = change(model.of_time(place + away, t), model.of_time(place, t))
        return w.place * of_place + w.time * of_time

    def header(self, model: SceneModel) -> dict[str, Any]:
        assert isinstance(model, Grid4D)
        return {name: getattr(model.config, name) for name in SIZES}

    def blank_of_file(self, config: dict[str, Any], tensors: dict[str, Tensor], path: Path) -> Grid4D:
        """Tables are made once the file is known to have them: a header alone could ask for gigabytes."""
        sizes = sizes_of(config, path)
        place, time = grid_sizes(sizes)
        named = {f"place_grid.levels.{i}": size for i, size in enumerate(place)}
        named |= {f"time_grids.{g}.levels.{i}": size for g in range(len(PAIRS)) for i, size in enumerate(time)}
        for name, size in named.items():
            expected = (rows_of(size, sizes.table), sizes.features)
            if (found := tuple(tensor_of(tensors, name, path).shape)) != expected:
                raise InputError(f"{path}: {name} is {found}, expected {expected}; train the model again")
        return Grid4D(sizes, blank_rows(len(tensor_of(tensors, "free.position", path))))


def sizes_of(config: dict[str, Any], path: Path) -> ModelConfig:
    """The grids and the network of a file's header. Raises InputError for sizes that no training writes."""
    missing = [name for name in SIZES if name not in config]
    if missing:
        raise InputError(f"{path}: the header's config is wrong (it lacks {missing[0]}); train the model again")
    return changed(ModelConfig(), {name: config[name] for name in SIZES}, lambda key: f"{path}: config: {key}")


METHOD = Grid4DMethod()
