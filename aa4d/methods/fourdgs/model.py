"""4D-GS's deformation: features of six planes at a Gaussian's place, multiplied, become residuals of what it owns."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor, nn

from aa4d.field.mlp import TwoLayer, evaluate_together
from aa4d.field.planes import FeaturePlanes
from aa4d.kernels.plane_lookup import look_up
from aa4d.methods.fourdgs.settings import ModelConfig
from aa4d.methods.gaussians.model import GaussianModel, GaussianRows, blank_rows


class FourDGS(GaussianModel):
    def __init__(self, config: ModelConfig, rows: GaussianRows) -> None:
        super().__init__(rows)
        c = config
        assert c.temporal_resolution is not None, "the number of frames tells it before a model is made"
        self.config = config
        self.field = FeaturePlanes(c.plane_dim, c.spatial_resolutions, c.temporal_resolution)
        self.encoder = nn.Linear(c.plane_dim * self.field.levels, c.width)
        nn.init.xavier_uniform_(self.encoder.weight)
        self.head_position = TwoLayer(c.width, c.width, 3, zero_output=c.still_start)
        self.head_log_scale = TwoLayer(c.width, c.width, 3, zero_output=c.still_start)
        self.head_quaternion = TwoLayer(c.width, c.width, 4, zero_output=c.still_start)

    def parameter_groups(self, *, canonical: bool) -> dict[str, list[nn.Parameter]]:
        groups = self.row_groups()
        if not canonical:
            groups["planes"] = list(self.field.parameters())
            deforming = (self.encoder, self.head_position, self.head_log_scale, self.head_quaternion)
            groups["deformation"] = [p for module in deforming for p in module.parameters()]
        return groups

    def deformed(self, rows: GaussianRows, t: float, index: Tensor | None = None) -> GaussianRows:  # noqa: ARG002
        place = rows.position if self.config.learn_lookup else rows.position.detach()
        features = look_up(self.field.in_order(), self.field.normalise(place), t, None)
        z = torch.relu(self.encoder(features))
        shift, growth, turn = evaluate_together((self.head_position, self.head_log_scale, self.head_quaternion), z)
        return replace(
            rows,
            position=rows.position + shift,
            log_scale=rows.log_scale + growth,
            quaternion=rows.quaternion + turn,
        )

    def set_box(self, points: Tensor) -> None:
        """The planes cover the points [P, 3] that training begins with."""
        self.field.box.copy_(torch.stack([points.amin(0), points.amax(0)]))


def blank_model(config: ModelConfig, gaussians: int) -> FourDGS:
    """A model of the right shapes, to load a state into."""
    return FourDGS(config, blank_rows(gaussians))
