"""Anchor-Conditioned Feature Aggregation, ACFA (paper, section 4.2)."""

from __future__ import annotations

import torch
from torch import Tensor

from aa4d.field.mlp import TwoLayer, with_time
from aa4d.field.planes import PLANES


class AnchorConditionedAggregation(TwoLayer):
    """Phi_w and the weighted sum over planes. Starts at uniform weights 1/6: its output layer is zero."""

    def __init__(self, embedding_dim: int, hidden: int, channels: int) -> None:
        super().__init__(embedding_dim + 1, hidden, len(PLANES) * channels, zero_output=True)

    def weights(self, embedding: Tensor, t: float) -> Tensor:
        """w_{i,p,c}(t): softmax over the planes of Phi_w([e_i, t]); [N, E] -> [N, 6, C]."""
        scores = super().forward(with_time(embedding, t))
        return torch.softmax(scores.view(len(embedding), len(PLANES), -1), dim=1)

    def forward(self, features: Tensor, embedding: Tensor, t: float) -> Tensor:  # type: ignore[override]
        """h_{i,ACFA}(t): the same weights at every level, levels concatenated coarsest first.

        Args:
            features: [L, N, 6, C] plane features.
            embedding: [N, E] e_i^acfa.

        Returns:
            [N, L * C]
        """
        aggregated = (self.weights(embedding, t) * features).sum(dim=2)  # [L, N, C]
        return aggregated.transpose(0, 1).flatten(1)
