"""MoRel's anchors: a set for each key frame, which deforms over its window of time; two sets are drawn at a time."""

from __future__ import annotations

from dataclasses import fields, replace
from enum import IntEnum
from typing import Any

import torch
from torch import Tensor, nn

from aa4d.anchors.canonical import AnchorRows, Anchors
from aa4d.anchors.decoding import AnchorState, Decoder
from aa4d.field.mlp import TwoLayer, evaluate_together
from aa4d.field.planes import FeaturePlanes
from aa4d.kernels.plane_lookup import look_up
from aa4d.methods.anchor_model import camera_center
from aa4d.methods.morel.settings import ModelConfig
from aa4d.methods.morel.windows import (
    SOFTPLUS_OF_ONE,
    learned_weight,
    linear_weight,
    local_time,
    nearest,
    neighbours,
)
from aa4d.methods.scene_model import SceneModel
from aa4d.raster.types import Camera, Gaussians

BLENDING = ("blend_center", "blend_decay")


class Phase(IntEnum):
    """How far training has come."""

    GLOBAL = 0  # one set of anchors, in which nothing moves
    KEYS = 1  # a set for each key frame; the nearest is drawn
    WINDOWS = 2  # each deforms over its window; the two neighbours are blended linearly
    BLENDED = 3  # by weights that each anchor has learned


class Window(nn.Module):
    """D_n: residuals of a key frame's anchors at tau in [-1, 1], one step to either side."""

    def __init__(self, c: ModelConfig) -> None:
        super().__init__()
        self.field = FeaturePlanes(c.plane_dim, c.spatial_resolutions, c.temporal_resolution)
        self.encoder = nn.Linear(c.plane_dim * self.field.levels, c.width)
        nn.init.xavier_uniform_(self.encoder.weight)
        # Zero at the start, so that a window begins with the anchors of its key frame.
        self.head_position = TwoLayer(c.width, c.width, 3, zero_output=True)
        self.head_feature = TwoLayer(c.width, c.width, c.feature_dim, zero_output=True)
        self.head_offset = TwoLayer(c.width, c.width, 3 * c.offsets, zero_output=True)
        self.head_log_scale = TwoLayer(c.width, c.width, 6, zero_output=True)

    def forward(self, a: AnchorRows, tau: float) -> AnchorState:
        features = look_up(self.field.in_order(), self.field.normalise(a.position), (tau + 1) / 2, None)
        z = torch.relu(self.encoder(features))
        heads = (self.head_position, self.head_feature, self.head_offset, self.head_log_scale)
        shift, feature, offset, growth = evaluate_together(heads, z)
        return AnchorState(
            position=a.position + shift,
            feature=a.feature + feature,
            offset=a.offset + offset.unflatten(1, (-1, 3)),
            scale=(a.log_scale + growth).exp(),
        )


class MoRel(SceneModel):
    """N anchors over all key frames. What `side` and `progress` say, training sets before each step."""

    key: Tensor  # [N] int64, the key frame that an anchor belongs to
    level: Tensor  # [N] int64, how soon it grows
    phase: Tensor  # int64, a `Phase`

    def __init__(self, config: ModelConfig, anchors: Anchors) -> None:
        super().__init__()
        assert config.keys is not None, "the number of frames tells it before a model is made"
        c, n = config, len(anchors)
        self.config = config
        self.keys = config.keys
        self.per_unit = c.offsets
        self.anchors = anchors
        self.decoder = Decoder(c.feature_dim, c.offsets, c.decoder_hidden)
        self.register_buffer("key", torch.zeros(n, dtype=torch.long))
        self.register_buffer("level", torch.zeros(n, dtype=torch.long))
        self.register_buffer("phase", torch.tensor(int(Phase.GLOBAL)))
        self.blend_center = nn.Parameter(torch.zeros(n, 2))
        self.blend_decay = nn.Parameter(torch.full((n, 2), SOFTPLUS_OF_ONE))
        self.windows = nn.ModuleList(Window(c) for _ in range(self.keys))
        self.side: int | None = None  # of the neighbours, the one that is drawn alone; None: both
        self.progress = 0.0  # share of the stage that is over

    def __len__(self) -> int:
        return len(self.anchors)

    def unit_tensors(self) -> tuple[str, ...]:
        owned = [field.name for field in fields(AnchorRows) if getattr(self.anchors, field.name) is not None]
        return (*(f"anchors.{name}" for name in owned), "key", "level", *BLENDING)

    def parameter_groups(self, *, canonical: bool) -> dict[str, list[nn.Parameter]]:  # noqa: ARG002, the phase tells
        if self.phase == Phase.BLENDED:
            return {"blending": [self.blend_center, self.blend_decay]}
        groups: dict[str, list[nn.Parameter]] = {
            "offset": [self.anchors.offset],
            "feature": [self.anchors.feature],
            "log_scale": [self.anchors.log_scale],
            "decoder_opacity": list(self.decoder.opacity.parameters()),
            "decoder_color": list(self.decoder.color.parameters()),
            "decoder_covariance": list(self.decoder.covariance.parameters()),
        }
        if self.phase == Phase.WINDOWS:
            groups |= {"planes": [], "position": [], "deformation": []}
            for window in self.deformations():
                groups["planes"] += window.field.parameters()
                groups["position"] += window.head_position.parameters()
                for module in (window.encoder, window.head_feature, window.head_offset, window.head_log_scale):
                    groups["deformation"] += module.parameters()
        return groups

    def deformations(self) -> list[Window]:
        return [window for window in self.windows if isinstance(window, Window)]

    def drawn_keys(self, t: float | None) -> tuple[int, ...]:
        """The key frames whose anchors are drawn at t; of the canonical scene the first one's."""
        if t is None or self.phase == Phase.GLOBAL:
            return (0,)
        if self.phase == Phase.KEYS:
            return (nearest(t, self.keys),)
        both = neighbours(t, self.keys)
        return both if self.side is None else (both[self.side],)

    def present(self, t: float | None) -> Tensor:
        return torch.isin(self.key, self.key.new_tensor(self.drawn_keys(t)))

    def resting(self, t: float | None) -> Tensor:  # noqa: ARG002, anchors rest where their key frame has them
        return self.anchors.position

    def centers(self, t: float | None) -> Tensor:
        if t is None or self.phase < Phase.WINDOWS:
            return self.anchors.position
        return self.deformed(self.anchors.rows(), self.key, t).position

    def gaussians(self, t: float | None, camera: Camera, visible: Tensor | None = None) -> Gaussians:
        a, eye = self.anchors.rows(visible), camera_center(camera)
        key = self.key if visible is None else self.key[visible]
        # Once blending is learned, nothing else learns: no gradient is to go farther than the weights.
        with torch.set_grad_enabled(torch.is_grad_enabled() and int(self.phase) != Phase.BLENDED):
            if t is None or self.phase < Phase.WINDOWS:
                state = AnchorState(a.position, a.feature, a.offset, a.log_scale.exp())
            else:
                state = self.deformed(a, key, t)
            gaussians = self.decoder(state, eye)
        weight = self.weights(key, t, visible)
        return replace(gaussians, opacities=gaussians.opacities * weight.repeat_interleave(self.per_unit))

    def deformed(self, a: AnchorRows, key: Tensor, t: float) -> AnchorState:
        """Anchors [M] of the key frames `key` [M] at t, each by the deformation of its own window."""
        parts, places = [], []
        for n, window in enumerate(self.deformations()):
            rows = (key == n).nonzero()[:, 0]
            if len(rows):
                parts.append(window(_selected(a, rows), local_time(t, n, self.keys)))
                places.append(rows)
        if len(parts) == 1:
            return parts[0]
        back = torch.cat(places or [key]).argsort()
        return AnchorState(*(torch.cat([getattr(p, f.name) for p in parts])[back] for f in fields(AnchorState)))

    def weights(self, key: Tensor, t: float | None, visible: Tensor | None = None) -> Tensor:
        """What the opacities of anchors [M] (those at `visible`) of the key frames `key` are multiplied by, [M]."""
        weight = self.blend_center.new_zeros(len(key))
        drawn = self.drawn_keys(t)
        for n in drawn:
            if len(drawn) == 1 or t is None:
                weight = torch.where(key == n, 1.0, weight)
                continue
            tau = local_time(t, n, self.keys)
            if self.phase == Phase.BLENDED:
                center, decay = (v if visible is None else v[visible] for v in (self.blend_center, self.blend_decay))
                weight = torch.where(key == n, learned_weight(tau, center, decay, self.config.decay_strength), weight)
            else:
                weight = torch.where(key == n, linear_weight(tau), weight)
        return weight

    @torch.no_grad()
    def split_into_keys(self, level: Tensor) -> None:
        """Give each key frame a copy of the anchors, whose levels [N] they keep; from then on each is its own."""
        count = len(self)
        self.level.copy_(level)
        for name in self.unit_tensors():
            old = self.tensor(name)
            value = old.detach().repeat(self.keys, *[1] * (old.dim() - 1))
            self.replace_tensor(name, nn.Parameter(value) if isinstance(old, nn.Parameter) else value)
        self.key = torch.arange(self.keys, device=self.key.device).repeat_interleave(count)
        for window in self.deformations():
            position = self.anchors.position
            window.field.box.copy_(torch.stack([position.amin(0), position.amax(0)]))


def _selected(a: AnchorRows, rows: Tensor) -> AnchorRows:
    given = ((field.name, getattr(a, field.name)) for field in fields(AnchorRows))
    selected: dict[str, Any] = {name: None if v is None else v.index_select(0, rows) for name, v in given}
    return AnchorRows(**selected)


def blank_model(config: ModelConfig, anchors: int) -> MoRel:
    """A model of the right shapes, to load a state into."""
    c = config
    zeros = torch.zeros(anchors, 3), torch.zeros(anchors, 6)
    return MoRel(c, Anchors(*zeros, c.offsets, c.feature_dim, 1, embeddings=()))
