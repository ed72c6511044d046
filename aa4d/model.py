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

    def canonical(self, a: AnchorRows) -> AnchorState:
        """A_i as the coarse stage has it."""
        return AnchorState(a.position, a.feature, a.offset, a.log_scale.exp())

    def deformed(self, a: AnchorRows, t: float) -> AnchorState:
        """A_i(t) for one t in [0, 1] (paper, sections 4.2 to 4.4)."""
        u = self.warp(self.field.normalise(a.position))
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
        rows = self.anchors.rows(visible)
        state = self.canonical(rows) if t is None else self.deformed(rows, t)
        return self.decoder(state, camera_centre(camera))

    def networks_and_planes(self) -> list[Tensor]:
        """What "neural size" counts in the field's tables: everything but the anchors' own attributes."""
        return [p for name, p in self.state_dict().items() if not name.startswith("anchors.")]


def blank_model(config: ModelConfig, anchors: int) -> AdaAnchor4D:
    """A model of the right shapes, to load a state into."""
    c = config
    zeros = torch.zeros(anchors, 3), torch.zeros(anchors, 6)
    return AdaAnchor4D(c, Anchors(*zeros, c.offsets, c.feature_dim, c.embedding_dim, embeddings=c.embeddings()))


def camera_centre(camera: Camera) -> Tensor:
    """-R^T T, [3]."""
    return -camera.viewmat[:3, :3].T @ camera.viewmat[:3, 3]
