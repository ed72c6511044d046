"""MoDec-GS's two deformations: of anchors, with gates, and of Gaussians. Both read six planes that are multiplied."""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor, nn

from aa4d.anchors.decoding import AnchorState
from aa4d.field.mlp import TwoLayer, evaluate_together
from aa4d.field.planes import FeaturePlanes
from aa4d.kernels.plane_lookup import look_up
from aa4d.methods.modec.settings import FieldConfig, ModelConfig
from aa4d.raster.types import Gaussians

STILL = 0.01  # an anchor stays where it is when its first gate is below


def start_of_interval(t: float, intervals: int) -> float:
    """When the interval that holds t in [0, 1] begins; 1 belongs to the last one."""
    return min(math.floor(t * intervals), intervals - 1) / intervals


class Deformation(nn.Module):
    """Planes and the trunk of the heads."""

    def __init__(self, field: FieldConfig, model: ModelConfig) -> None:
        super().__init__()
        assert field.temporal_resolution is not None, "the number of frames tells it before a model is made"
        self.learn_lookup = model.learn_lookup
        self.field = FeaturePlanes(field.plane_dim, field.spatial_resolutions, field.temporal_resolution)
        self.encoder = nn.Linear(field.plane_dim * self.field.levels, field.width)
        nn.init.xavier_uniform_(self.encoder.weight)

    def features(self, place: Tensor, t: float) -> Tensor:
        """What heads take, of places [N, 3] at t: [N, W]."""
        place = place if self.learn_lookup else place.detach()
        return torch.relu(self.encoder(look_up(self.field.in_order(), self.field.normalise(place), t, None)))


class AnchorDeformation(Deformation):
    """Residuals of all that an anchor's Gaussians are decoded from."""

    def __init__(self, field: FieldConfig, model: ModelConfig) -> None:
        super().__init__(field, model)
        width, still = field.width, model.still_start
        self.head_position = TwoLayer(width, width, 3, zero_output=still)
        self.head_feature = TwoLayer(width, width, model.feature_dim, zero_output=still)
        self.head_offset = TwoLayer(width, width, 3 * model.offsets, zero_output=still)
        self.head_scale = TwoLayer(width, width, 6, zero_output=still)

    def forward(self, state: AnchorState, dynamics: Tensor | None, t: float) -> AnchorState:
        """At t; `dynamics` [N, 2] are the logits of the gates, None where there are none.

        A scale changes by a sum, as in MoDec-GS, and may turn negative: covariances do not see its sign.
        """
        heads = (self.head_position, self.head_feature, self.head_offset, self.head_scale)
        shift, feature, offset, scale = evaluate_together(heads, self.features(state.position, t))
        if dynamics is not None:
            gate = torch.sigmoid(dynamics)
            # Open or closed, and learned as if it were neither.
            moves = gate[:, :1] + ((gate[:, :1] > STILL).to(gate.dtype) - gate[:, :1]).detach()
            changes = gate[:, 1:]
            shift, feature, offset, scale = shift * moves, feature * changes, offset * changes, scale * changes
        return AnchorState(
            position=state.position + shift,
            feature=state.feature + feature,
            offset=state.offset + offset.view_as(state.offset),
            scale=state.scale + scale,
        )


class GaussianDeformation(Deformation):
    """Residuals of the places, scales and rotations of decoded Gaussians."""

    def __init__(self, field: FieldConfig, model: ModelConfig) -> None:
        super().__init__(field, model)
        width, still = field.width, model.still_start
        self.head_position = TwoLayer(width, width, 3, zero_output=still)
        self.head_scale = TwoLayer(width, width, 3, zero_output=still)
        self.head_quaternion = TwoLayer(width, width, 4, zero_output=still)

    def forward(self, gaussians: Gaussians, t: float) -> Gaussians:
        """At t. What is not drawn is left as it is: a Gaussian's opacity does not change here."""
        drawn = (gaussians.opacities > 0).nonzero()[:, 0]
        heads = (self.head_position, self.head_scale, self.head_quaternion)
        place = gaussians.means.index_select(0, drawn)
        shift, growth, turn = evaluate_together(heads, self.features(place, t))
        return replace(
            gaussians,
            means=gaussians.means.index_add(0, drawn, shift),
            scales=gaussians.scales.index_add(0, drawn, growth),
            quaternions=gaussians.quaternions.index_add(0, drawn, turn),
        )
