"""SD-GS: places and scales of anchors deform at each time; decoders see the time as well."""

from __future__ import annotations

from dataclasses import dataclass, fields

import torch
from torch import Tensor, nn

from aa4d.anchors.canonical import AnchorRows, Anchors
from aa4d.anchors.decoding import AnchorState, Decoder
from aa4d.field.encoding import encoded
from aa4d.field.mlp import TwoLayer, evaluate_together
from aa4d.field.planes import FeaturePlanes
from aa4d.kernels.plane_lookup import look_up
from aa4d.methods.anchor_model import AnchorModel, camera_center
from aa4d.methods.sdgs.settings import ModelConfig
from aa4d.raster.types import Camera, Gaussians


@dataclass(frozen=True, kw_only=True)
class DeformedGaussians(Gaussians):
    """Gaussians at a time, and how much their anchors have changed; without gradients."""

    moved: Tensor  # [M] of each visible anchor, model units
    scaled: Tensor  # [M] norm of the change of its log scales


class Deformation(nn.Module):
    """Residuals of place and log scales, of six planes that are multiplied."""

    def __init__(self, config: ModelConfig) -> None:
        super().__init__()
        c = config
        assert c.temporal_resolution is not None, "the number of frames tells it before a model is made"
        self.learn_lookup = c.learn_lookup
        self.field = FeaturePlanes(c.plane_dim, c.spatial_resolutions, c.temporal_resolution)
        self.encoder = nn.Linear(c.plane_dim * self.field.levels, c.width)
        nn.init.xavier_uniform_(self.encoder.weight)
        self.head_position = TwoLayer(c.width, c.width, 3, zero_output=c.still_start)
        self.head_log_scale = TwoLayer(c.width, c.width, 6, zero_output=c.still_start)

    def forward(self, position: Tensor, t: float) -> tuple[Tensor, Tensor]:
        """[N, 3] and [N, 6] at t."""
        place = self.field.normalise(position if self.learn_lookup else position.detach())
        z = torch.relu(self.encoder(look_up(self.field.in_order(), place, t, None)))
        shift, growth = evaluate_together((self.head_position, self.head_log_scale), z)
        return shift, growth


class Sdgs(AnchorModel):
    def __init__(self, config: ModelConfig, position: Tensor, log_scale: Tensor) -> None:
        """Positions [N, 3] and log scales [N, 6] of the anchors."""
        c, times = config, 1 + 2 * config.time_frequencies
        super().__init__(
            Anchors(position, log_scale, c.offsets, c.feature_dim, 2, embeddings=()),
            Decoder(c.feature_dim + times, c.offsets, c.decoder_hidden),
        )
        self.config = config
        self.deformation = Deformation(config)
        self._times = times
        # Decoders learn a static scene first, to which the time says nothing: they begin to listen where that ends.
        with torch.no_grad():
            for network in (self.decoder.opacity, self.decoder.color, self.decoder.covariance):
                network.hidden.weight[:, c.feature_dim : c.feature_dim + times] = 0

    def parameter_groups(self, *, canonical: bool) -> dict[str, list[nn.Parameter]]:
        groups = self.static_groups()
        if canonical:
            return groups
        field = self.deformation.field
        of_field = {id(p) for p in field.parameters()}
        others = [p for p in self.deformation.parameters() if id(p) not in of_field]
        return groups | {"planes": list(field.parameters()), "deformation": others}

    def canonical(self, a: AnchorRows) -> AnchorState:
        """The static scene: decoders see no time."""
        return self._timed(a.position, a.feature, a.offset, a.log_scale.exp(), None)

    def deformed(self, a: AnchorRows, t: float) -> AnchorState:
        shift, growth = self.deformation(a.position, t)
        return self._timed(a.position + shift, a.feature, a.offset, (a.log_scale + growth).exp(), t)

    def gaussians(self, t: float | None, camera: Camera, visible: Tensor | None = None) -> Gaussians:
        if t is None:
            return super().gaussians(t, camera, visible)
        a = self.anchors.rows(visible)
        state = self.deformed(a, t)
        drawn = self.decoder(state, camera_center(camera))
        with torch.no_grad():
            moved = (state.position - a.position).norm(dim=1)
            scaled = (state.scale.log() - a.log_scale).norm(dim=1)
        values = {field.name: getattr(drawn, field.name) for field in fields(Gaussians)}
        return DeformedGaussians(**values, moved=moved, scaled=scaled)

    def _timed(self, position: Tensor, feature: Tensor, offset: Tensor, scale: Tensor, t: float | None) -> AnchorState:
        """With the encoded time behind the features; zeros for no time."""
        time = feature.new_zeros(1, self._times)
        if t is not None:
            time = encoded(feature.new_tensor([[t]]), self.config.time_frequencies)
        return AnchorState(position, torch.cat([feature, time.expand(len(feature), -1)], dim=1), offset, scale)


def blank_model(config: ModelConfig, anchors: int) -> Sdgs:
    """A model of the right shapes, to load a state into."""
    return Sdgs(config, torch.zeros(anchors, 3), torch.zeros(anchors, 6))
