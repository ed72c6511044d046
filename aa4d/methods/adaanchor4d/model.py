"""AdaAnchor4D: the modules of the paper tied together."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from aa4d.anchors.canonical import EMBEDDINGS, AnchorRows, Anchors
from aa4d.anchors.decoding import AnchorState, Decoder
from aa4d.field.mlp import TwoLayer, evaluate_together
from aa4d.field.planes import FeaturePlanes
from aa4d.methods.adaanchor4d.aggregation import Weighted, make_aggregation
from aa4d.methods.adaanchor4d.geometry import OffsetDeformation, ScaleDeformation
from aa4d.methods.adaanchor4d.settings import ModelConfig
from aa4d.methods.adaanchor4d.warping import CoordinateWarp
from aa4d.methods.anchor_model import AnchorModel


def embeddings_of(config: ModelConfig) -> tuple[str, ...]:
    """Names of the embeddings that each anchor owns."""
    return EMBEDDINGS if config.dlgd else EMBEDDINGS[:1]


class AdaAnchor4D(AnchorModel):
    """Anchors, the shared field and the networks. Module names are the tensor names of docs/formats.md, or become them
    in files.py."""

    def __init__(self, config: ModelConfig, anchors: Anchors) -> None:
        c = config
        assert c.temporal_resolution is not None, "the number of frames tells it before a model is made"
        # What every variant has comes first: variants of one seed then start from the same planes and decoder.
        super().__init__(anchors, Decoder(c.feature_dim, c.offsets, c.decoder_hidden))
        self.config = config
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

    def parameter_groups(self, *, canonical: bool) -> dict[str, list[nn.Parameter]]:
        groups = self.static_groups()
        if not canonical:
            deforming = [self.aggregation, self.encoder, self.head_feature]
            if self.config.dlgd:
                deforming += [self.dlgd_offset, self.dlgd_scale]
            groups["embedding"] = [getattr(self.anchors, name) for name in embeddings_of(self.config)]
            groups["planes"] = list(self.field.parameters())
            groups["position"] = list(self.head_position.parameters())
            groups["deformation"] = [p for module in deforming for p in module.parameters()]
            if self.groups is not None:
                groups["tracks"], groups["heading"] = [self.groups.position], [self.groups.heading]
        return groups

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

    @torch.no_grad()
    def plane_weights(self, t: float) -> Tensor | None:
        """[N, 6] weights over the planes, mean over channels; None where the aggregation has none."""
        if not isinstance(self.aggregation, Weighted):
            return None
        return self.aggregation.weights(self.anchors.rows().embedding_acfa, t).mean(2)

    def warp_boundaries(self) -> Tensor:
        """[3, B + 1] where DACW takes the edges of B equal bins of [-1, 1], on each axis."""
        return self.warp.boundaries


def blank_model(config: ModelConfig, anchors: int) -> AdaAnchor4D:
    """A model of the right shapes, to load a state into."""
    c = config
    zeros = torch.zeros(anchors, 3), torch.zeros(anchors, 6)
    return AdaAnchor4D(c, Anchors(*zeros, c.offsets, c.feature_dim, c.embedding_dim, embeddings=embeddings_of(c)))
