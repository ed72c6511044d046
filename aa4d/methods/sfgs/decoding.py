"""From anchors in space and time to Gaussians at a time: where each is then, and how much of it is left."""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from aa4d.field.mlp import TwoLayer, evaluate_together
from aa4d.methods.sfgs.settings import ModelConfig
from aa4d.raster.types import Gaussians

GONE = 30.0  # the exponent beyond which a Gaussian fades no more: 1e-13 is left, and no number is denormal, thus slow


@dataclass(frozen=True)
class AnchorRows4D:
    """What N anchors own: lengths in model units, times in seconds."""

    position: Tensor  # [N, 4] x, y, z and time
    feature: Tensor  # [N, F]
    offset: Tensor  # [N, K, 4]
    log_scale: Tensor  # [N, 7] of offsets in x, y, z and time, and of covariances

    def moments(self) -> Tensor:
        """[N, K, 4] where and when each Gaussian is at its fullest."""
        return self.position[:, None] + self.offset * self.log_scale[:, None, :4].exp()


@dataclass(frozen=True, kw_only=True)
class TimedGaussians(Gaussians):
    """Gaussians at a time; their opacities have faded already."""

    lasting: Tensor  # [N] opacity before fading
    fade: Tensor  # [N] what is left of it, in [0, 1]
    rate: Tensor  # [N] of fading, 1 / seconds


class Decoder4D(nn.Module):
    """Four networks of an anchor's feature; color alone sees the direction of view."""

    def __init__(self, config: ModelConfig) -> None:
        super().__init__()
        c = config
        self.beta, self.fastest = c.beta, c.fastest
        self.opacity = TwoLayer(c.feature_dim, c.decoder_hidden, c.offsets)
        self.color = TwoLayer(c.feature_dim + 3, c.decoder_hidden, 3 * c.offsets)
        self.covariance = TwoLayer(c.feature_dim, c.decoder_hidden, 8 * c.offsets)
        self.velocity = TwoLayer(c.feature_dim, c.decoder_hidden, 3 * c.offsets, zero_output=c.still_start)

    def forward(self, a: AnchorRows4D, camera_center: Tensor, seconds: float | None) -> TimedGaussians:
        """N anchors -> N * K Gaussians, those of an anchor together, at a time; for `seconds` = None as if they lasted
        and stood still.
        """
        toward = F.normalize(a.position[:, :3] - camera_center, dim=1)
        color = self.color(torch.cat([a.feature, toward], dim=1))
        opacity, covariance, velocity = evaluate_together((self.opacity, self.covariance, self.velocity), a.feature)
        shares, life, quaternions = covariance.unflatten(1, (-1, 8)).split([3, 1, 4], dim=2)
        means, moment = a.moments().split([3, 1], dim=2)
        lasting, rate = torch.tanh(opacity).clamp_min(0), 1 + F.elu(life[..., 0])  # a network that says nothing: 1 s
        fade = torch.ones_like(lasting)
        if seconds is not None:
            ahead = moment - seconds
            means = means + self.velocity_of(velocity) * ahead
            fade = torch.exp(-(ahead[..., 0] * rate).abs().clamp(max=GONE ** (1 / self.beta)).pow(self.beta))
        largest = a.log_scale[:, None, 4:].exp()
        return TimedGaussians(
            means=means.flatten(0, 1),
            quaternions=quaternions.flatten(0, 1),
            scales=(largest * torch.sigmoid(shares)).flatten(0, 1),
            opacities=(lasting * fade).flatten(),
            colors=torch.sigmoid(color).view(-1, 3),
            lasting=lasting.detach().flatten(),
            fade=fade.detach().flatten(),
            rate=rate.detach().flatten(),
        )

    def velocity_of(self, output: Tensor) -> Tensor:
        """[N, 3 K] -> [N, K, 3] model units a second, positive where a Gaussian comes from."""
        return self.fastest * torch.tanh(output).unflatten(1, (-1, 3))

    def centers(self, a: AnchorRows4D, seconds: float) -> Tensor:
        """[N, 3] where anchors are at a time: they move as their Gaussians do in the mean."""
        ahead = a.moments()[..., 3:] - seconds
        return a.position[:, :3] + (self.velocity_of(self.velocity(a.feature)) * ahead).mean(1)
