"""MoRel as a method: global anchors, then those of key frames, then their windows, then the blending.

The publication trains one key frame after the other, so that no more than two are in memory; here every step draws the
one that its frame belongs to. Their parameters are apart, but for the decoders, which all share.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from aa4d.anchors.canonical import Anchors
from aa4d.anchors.densification import Statistics
from aa4d.errors import InputError
from aa4d.field.planes import regularisation
from aa4d.kernels.image_loss import image_loss
from aa4d.methods.anchor_growth import centers_of, edit_of, judge
from aa4d.methods.anchor_model import initial_places
from aa4d.methods.contract import Beginning, Method, Stage, UnitEdit
from aa4d.methods.morel.levels import growth_weight, levels_of
from aa4d.methods.morel.model import MoRel, Phase, blank_model
from aa4d.methods.morel.settings import MOST_KEYS, PRESETS, ModelConfig, MoRelSettings
from aa4d.methods.morel.windows import key_time
from aa4d.methods.rendering import Rendered
from aa4d.methods.scene_model import SceneModel
from aa4d.methods.tensors import tensor_of

PHASES = {"coarse": Phase.GLOBAL, "keys": Phase.KEYS, "windows": Phase.WINDOWS, "blending": Phase.BLENDED}
MAX_LEVELS = 8


class MoRelMethod(Method[MoRelSettings]):
    name = MoRelSettings.method
    presets = PRESETS

    def resolved(self, settings: MoRelSettings, frames: int) -> MoRelSettings:
        if settings.model.keys is not None:
            return settings
        keys = min(max(round((frames - 1) / settings.key_interval) + 1, 2), MOST_KEYS)
        return replace(settings, model=replace(settings.model, keys=keys))

    def stages(self, settings: MoRelSettings) -> tuple[Stage, ...]:
        s, fine = settings, settings.fine_iterations
        of_keys, blending = round(s.key_share * fine), round(s.blend_share * fine)
        spans: tuple[tuple[float, float], ...] = ()
        if (keys := s.model.keys) is not None:
            reach = s.key_tolerance / (keys - 1)
            spans = tuple((key_time(n, keys) - reach, key_time(n, keys) + reach) for n in range(keys))
        stages = (
            Stage("coarse", s.coarse_iterations, draws=0, canonical=True),
            Stage("keys", of_keys, draws=1, spans=spans),
            Stage("windows", fine - of_keys - blending, draws=2),
            Stage("blending", blending, draws=3, changes_units=False),
        )
        return tuple(stage for stage in stages if stage.iterations or stage.name == "keys")

    def initial(self, settings: MoRelSettings, beginning: Beginning) -> MoRel:
        torch.manual_seed(settings.seed)
        c = settings.model
        places = initial_places(beginning, settings.voxel_px * beginning.pixel)
        return MoRel(c, Anchors(*places, c.offsets, c.feature_dim, 1, embeddings=()))

    def blank(self, settings: MoRelSettings, units: int) -> MoRel:
        return blank_model(settings.model, units)

    def enter(self, stage: Stage, model: SceneModel, settings: MoRelSettings) -> None:
        """The anchors of key frames are copies of the global ones, with levels by the variance of their features."""
        assert isinstance(model, MoRel)
        model.side = None
        model.phase.fill_(int(PHASES[stage.name]))
        if stage.name == "keys":
            model.split_into_keys(levels_of(model.anchors.feature, settings.densification.variance_quantiles))

    def begin_step(self, stage: Stage, iteration: int, model: SceneModel, settings: MoRelSettings) -> None:
        """Of the two windows that a frame lies in, one learns from it, so that none covers for the other."""
        assert isinstance(model, MoRel)
        model.progress = iteration / stage.iterations
        if stage.name == "windows":
            model.side = int(np.random.default_rng([settings.seed, stage.draws, iteration]).integers(2))

    def image_loss(self, rendered: Rendered, target: Tensor, settings: MoRelSettings) -> tuple[Tensor, Tensor]:
        return image_loss(rendered.rendering.color, target, settings.loss.dssim)

    def penalty(self, stage: Stage, model: SceneModel, settings: MoRelSettings) -> Tensor | None:
        """The mean over the windows: each learns from its share of the steps."""
        assert isinstance(model, MoRel)
        if stage.name != "windows":
            return None
        w = settings.loss
        weights = w.plane_smoothness, w.time_smoothness, w.time_constancy
        return torch.stack([regularisation(window.field, *weights) for window in model.deformations()]).mean()

    def edit(
        self,
        model: SceneModel,
        statistics: Statistics,
        settings: MoRelSettings,
        pixel: float,
        generator: torch.Generator,
    ) -> UnitEdit:
        """Grow and prune each key frame's anchors by themselves; a frame shows those of one key frame alone."""
        assert isinstance(model, MoRel)
        d, anchors, voxel = settings.densification, model.anchors, settings.voxel_px * pixel
        apart = model.phase != Phase.GLOBAL
        keep, growth = judge(
            d,
            statistics,
            anchors.position,
            centers_of(anchors),
            voxel=voxel,
            generator=generator,
            seen=d.interval * d.seen_share / (model.keys if apart else 1),
            weight=growth_weight(model.level, d.delayed, model.progress) if apart else None,
            group=model.key if apart else None,
            group_voxel=voxel,
        )
        return edit_of(anchors, keep, growth)

    def header(self, model: SceneModel) -> dict[str, Any]:
        assert isinstance(model, MoRel)
        c = model.config
        return {
            "keys": model.keys,
            "offsets": c.offsets,
            "feature_dim": c.feature_dim,
            "plane_dim": c.plane_dim,
            "levels": len(c.spatial_resolutions),
            "decay_strength": c.decay_strength,
        }

    def blank_of_file(self, config: dict[str, Any], tensors: dict[str, Tensor], path: Path) -> MoRel:
        """Sizes that the header does not state stand in the tensors' shapes."""
        try:
            keys, levels = config["keys"], config["levels"]
            if type(keys) is not int or not 2 <= keys <= MOST_KEYS:
                raise ValueError(f"keys is {keys}")
            if type(levels) is not int or not 1 <= levels <= MAX_LEVELS:
                raise ValueError(f"levels is {levels}")
            strength = float(config["decay_strength"])
            if not 0 < strength < 1e6:
                raise ValueError(f"decay_strength is {strength}")
            rows = [tensor_of(tensors, f"windows.0.field.planes.{level}.xt", path).shape for level in range(levels)]
            feature, offset = (tensor_of(tensors, f"anchors.{name}", path) for name in ("feature", "offset"))
            sizes = ModelConfig(
                offsets=offset.shape[1],
                feature_dim=feature.shape[1],
                decoder_hidden=len(tensor_of(tensors, "decoder.opacity.hidden.bias", path)),
                keys=keys,
                plane_dim=rows[0][2],
                spatial_resolutions=tuple(shape[1] for shape in rows),
                temporal_resolution=rows[0][0],
                width=len(tensor_of(tensors, "windows.0.encoder.bias", path)),
                decay_strength=strength,
            )
            for name in ("offsets", "feature_dim", "plane_dim"):
                if getattr(sizes, name) != config[name]:
                    raise ValueError(f"{name} is not that of the tensors")
            return blank_model(sizes, len(feature))
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise InputError(f"{path}: the header's config is wrong ({error!r}); train the model again") from None

    def check(self, model: SceneModel, path: Path) -> None:
        """Raises InputError for a key frame or a phase that is not there."""
        assert isinstance(model, MoRel)
        if not ((model.key >= 0) & (model.key < model.keys)).all():
            raise InputError(f"{path}: key names a key frame that is not there (has {model.keys}); train it again")
        if int(model.phase) not in list(Phase):
            raise InputError(
                f"{path}: phase is {int(model.phase)}, expected one of 0 to {max(Phase):d}; train it again"
            )


METHOD = MoRelMethod()
