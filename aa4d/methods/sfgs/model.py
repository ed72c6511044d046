"""4D-SFGS: nothing deforms; anchors have a time, and their Gaussians come, move along lines and fade."""

from __future__ import annotations

from dataclasses import fields

import torch
from torch import Tensor, nn

from aa4d.methods.anchor_model import camera_center
from aa4d.methods.scene_model import SceneModel
from aa4d.methods.sfgs.decoding import AnchorRows4D, Decoder4D, TimedGaussians
from aa4d.methods.sfgs.settings import ModelConfig
from aa4d.raster.types import Camera


class Anchors4D(nn.Module):
    """N anchors in space and time. Both are fixed: offsets carry what is learned of them."""

    position: Tensor  # [N, 4]

    def __init__(self, position: Tensor, log_scale: Tensor, offsets: int, feature_dim: int) -> None:
        """Positions [N, 4], log scales [N, 7]."""
        super().__init__()
        n = len(position)
        self.register_buffer("position", position)
        self.feature = nn.Parameter(torch.zeros(n, feature_dim))
        self.offset = nn.Parameter(torch.zeros(n, offsets, 4))
        self.log_scale = nn.Parameter(log_scale)

    def rows(self, index: Tensor | None = None) -> AnchorRows4D:
        """All of them, or those at `index` [M]."""
        owned = (getattr(self, field.name) for field in fields(AnchorRows4D))
        return AnchorRows4D(*(v if index is None else v.index_select(0, index) for v in owned))


class Sfgs(SceneModel):
    clip_s: Tensor  # [] seconds from t = 0 to t = 1
    frame_s: Tensor  # [] from one frame to the next

    def __init__(self, config: ModelConfig, anchors: Anchors4D, clip_s: float, frame_s: float) -> None:
        super().__init__()
        self.config = config
        self.anchors = anchors
        self.decoder = Decoder4D(config)
        self.per_unit = config.offsets
        self.register_buffer("clip_s", torch.tensor(clip_s))
        self.register_buffer("frame_s", torch.tensor(frame_s))

    def __len__(self) -> int:
        return len(self.anchors.position)

    def unit_tensors(self) -> tuple[str, ...]:
        return tuple(f"anchors.{field.name}" for field in fields(AnchorRows4D))

    def parameter_groups(self, *, canonical: bool) -> dict[str, list[nn.Parameter]]:
        groups: dict[str, list[nn.Parameter]] = {
            "offset": [self.anchors.offset],
            "feature": [self.anchors.feature],
            "log_scale": [self.anchors.log_scale],
            "decoder_opacity": list(self.decoder.opacity.parameters()),
            "decoder_color": list(self.decoder.color.parameters()),
            "decoder_covariance": list(self.decoder.covariance.parameters()),
        }
        if not canonical:
            groups["decoder_velocity"] = list(self.decoder.velocity.parameters())
        return groups

    def gaussians(self, t: float | None, camera: Camera, visible: Tensor | None = None) -> TimedGaussians:
        seconds = None if t is None else t * float(self.clip_s)
        return self.decoder(self.anchors.rows(visible), camera_center(camera), seconds)

    def resting(self, t: float | None) -> Tensor:  # noqa: ARG002, an anchor stands still
        return self.anchors.position[:, :3]

    def centers(self, t: float | None) -> Tensor:
        if t is None:
            return self.resting(None)
        return self.decoder.centers(self.anchors.rows(), t * float(self.clip_s))


def blank_model(config: ModelConfig, anchors: int) -> Sfgs:
    """A model of the right shapes, to load a state into."""
    zeros = torch.zeros(anchors, 4), torch.zeros(anchors, 7)
    return Sfgs(config, Anchors4D(*zeros, config.offsets, config.feature_dim), 1.0, 1.0)
