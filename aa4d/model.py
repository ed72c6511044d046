"""AdaAnchor4D: the modules of the paper tied together."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from aa4d.anchors.canonical import EMBEDDINGS, AnchorRows, Anchors
from aa4d.anchors.decoding import AnchorState, Decoder
from aa4d.field.aggregation import make_aggregation
from aa4d.field.geometry import OffsetDeformation, ScaleDeformation
from aa4d.field.mlp import TwoLayer, evaluate_together
from aa4d.field.planes import FeaturePlanes
from aa4d.field.warping import CoordinateWarp
from aa4d.motion.groups import Groups, carry
from aa4d.raster.types import Camera, Gaussians


@dataclass(frozen=True)
class ModelConfig:
    """Sizes and switches. [paper] is stated there, the others as in aa4d/training/config.py."""

    offsets: int = 10  # K [Scaffold-GS]
    feature_dim: int = 32  # [Scaffold-GS]
    embedding_dim: int = 32  # [paper]
    plane_dim: int = 16  # C [4D-GS]; with 64 and 128 rows it gives the paper's neural sizes (docs/training.md)
    spatial_resolutions: tuple[int, ...] = (64, 128)  # one a level [4D-GS]
    temporal_resolution: int = 25  # rows along t; training sets it by the number of frames
    dlgd: bool = True  # off: offsets and scales do not deform
    dacw: bool = True  # off: the planes are queried at linearly normalised coordinates
    bins: int = 64  # [paper] of DACW
    weight_hidden: int = 256  # [paper] of Phi_w
    geometry_hidden: int = 128  # [paper] of Phi_o, Phi_s
    encoder_width: int = 128  # [MoDec-GS]
    decoder_hidden: int = 32  # [Scaffold-GS]
    aggregation: str = "acfa"  # [paper] a name in aa4d/field/aggregation.py

    def embeddings(self) -> tuple[str, ...]:
        """Names of the embeddings that each anchor owns."""
        return EMBEDDINGS if self.dlgd else EMBEDDINGS[:1]


class AdaAnchor4D(nn.Module):
    """Anchors, the shared field and the networks. Module names are the tensor names of docs/formats.md, or become them
    in aa4d/model_file.py."""

    def __init__(self, config: ModelConfig, anchors: Anchors) -> None:
        super().__init__()
        c = config
        self.config = config
        self.anchors = anchors
        # What every variant has comes first: variants of one seed then start from the same planes and decoder.
        self.decoder = Decoder(c.feature_dim, c.offsets, c.decoder_hidden)
        self.field = FeaturePlanes(c.plane_dim, c.spatial_resolutions, c.temporal_resolution)
        self.warp = CoordinateWarp(c.bins)
        self.encoder = nn.Linear(c.plane_dim * self.field.levels, c.encoder_width)  # Phi_enc
        nn.init.xavier_uniform_(self.encoder.weight)
        # The paper zero-initialises Phi_w, Phi_o and Phi_s only. Phi_x and Phi_f start at zero here as well, so that
        # the fine stage begins exactly where the coarse stage ended.
        self.head_position = TwoLayer(c.encoder_width, c.encoder_width, 3, zero_output=True)  # Phi_x
        self.head_feature = TwoLayer(c.encoder_width, c.encoder_width, c.feature_dim, zero_output=True)  # Phi_f
        self.aggregation = make_aggregation(c.aggregation, c.embedding_dim, c.weight_hidden, c.plane_dim)
        if c.dlgd:
            self.dlgd_offset = OffsetDeformation(c.embedding_dim, c.geometry_hidden, c.offsets)  # Phi_o
            self.dlgd_scale = ScaleDeformation(c.embedding_dim, c.geometry_hidden)  # Phi_s
        self.groups: Groups | None = None  # what anchors ride on; beyond the paper

    def ride(self, groups: Groups, group: Tensor) -> None:
        """Let anchors ride on rigid groups from now on: group [N], -1 for those that belong to the world."""
        self.groups = groups
        self.anchors.group = group

    def canonical(self, a: AnchorRows) -> AnchorState:
        """A_i as the coarse stage has it."""
        return AnchorState(a.position, a.feature, a.offset, a.log_scale.exp())

    def deformed(self, a: AnchorRows, t: float) -> AnchorState:
        """A_i(t) for one t in [0, 1] (paper, sections 4.2 to 4.4); of an anchor that rides, in its group's frame."""
        u = self.warp(self.field.normalise(self._in_world(a.position, a.group, None)))
        h = self.aggregation(self.field, u, a.embedding_acfa, t)
        z = torch.relu(self.encoder(h))
        shift, feature_change = evaluate_together((self.head_position, self.head_feature), z)
        offset, log_scale = a.offset, a.log_scale
        if a.embedding_offset is not None and a.embedding_scale is not None:
            offset = offset + self.dlgd_offset(a.embedding_offset, t)
            log_scale = log_scale + self.dlgd_scale(a.embedding_scale, t)
        return AnchorState(
            position=a.position + shift,
            feature=a.feature + feature_change,
            offset=offset,
            scale=log_scale.exp(),
        )

    def gaussians(self, t: float | None, camera: Camera, visible: Tensor | None = None) -> Gaussians:
        """What the anchors (those at `visible` [M], if given) look like to a camera at time t, K Gaussians each.

        At t = None the canonical scene: the coarse stage.
        """
        a = self.anchors.rows(visible)
        state = self.canonical(a) if t is None else self.deformed(a, t)
        eye = camera_centre(camera)
        if self.groups is None or a.group is None:
            return self.decoder(state, eye)
        rows = (a.group >= 0).nonzero()[:, 0]
        group = a.group[rows]
        pose = self.groups.pose(t).at(group)
        eyes = eye.expand_as(a.position).index_copy(0, rows, pose.to_group(eye.expand(len(rows), 1, 3))[:, 0])
        gaussians = self.decoder(state, eyes)
        return carry(gaussians, len(a.position), rows, pose, self.groups.presence(t)[group])

    def resting(self, t: float | None) -> Tensor:
        """[N, 3] where the anchors are at t but for the field's deformation, model frame."""
        return self._in_world(self.anchors.position, self.anchors.group, t)

    def centres(self, t: float | None) -> Tensor:
        """[N, 3] x_i(t): where the anchors are at t, model frame."""
        if t is None:
            return self.resting(None)
        return self._in_world(self.deformed(self.anchors.rows(), t).position, self.anchors.group, t)

    def present(self, t: float | None) -> Tensor | None:
        """[N] bool: the anchors that are there at t; None for all."""
        if self.groups is None or self.anchors.group is None:
            return None
        return (self.anchors.group < 0) | (self.groups.presence(t) > 0)[self.anchors.group.clamp_min(0)]

    def _in_world(self, position: Tensor, group: Tensor | None, t: float | None) -> Tensor:
        """Positions [N, 3] of anchors, in the frame of the groups [N] that they belong to, in the model's frame."""
        if self.groups is None or group is None:
            return position
        rows = (group >= 0).nonzero()[:, 0]
        pose = self.groups.pose(t).at(group[rows])
        return position.index_copy(0, rows, pose.to_world(position.index_select(0, rows)[:, None])[:, 0])

    def networks_and_planes(self) -> list[Tensor]:
        """What "neural size" counts in the field's tables: everything but the anchors' own attributes."""
        attributes = ("anchors.", "groups.")
        return [p for name, p in self.state_dict().items() if not name.startswith(attributes)]


def blank_model(config: ModelConfig, anchors: int, groups: Groups | None = None) -> AdaAnchor4D:
    """A model of the right shapes, to load a state into; anchors ride on `groups`, if given."""
    c = config
    zeros = torch.zeros(anchors, 3), torch.zeros(anchors, 6)
    model = AdaAnchor4D(c, Anchors(*zeros, c.offsets, c.feature_dim, c.embedding_dim, embeddings=c.embeddings()))
    if groups is not None:
        model.ride(groups, torch.zeros(anchors, dtype=torch.long))
    return model


def camera_centre(camera: Camera) -> Tensor:
    """-R^T T, [3]."""
    return -camera.viewmat[:3, :3].T @ camera.viewmat[:3, 3]
