"""Decoupled Local Geometry Deformation, DLGD (paper, section 4.3): residuals of offsets and scales."""

from __future__ import annotations

from torch import Tensor

from aa4d.field.mlp import TwoLayer


class OffsetDeformation(TwoLayer):
    """Phi_o: Delta O_i(t) from [e_i^o, t]. Zero at the start of training."""

    def __init__(self, embedding_dim: int, hidden: int, offsets: int) -> None:
        super().__init__(embedding_dim + 1, hidden, 3 * offsets, zero_output=True)

    def forward(self, embedding: Tensor, t: float) -> Tensor:  # type: ignore[override]
        """[N, E] -> [N, K, 3]"""
        return super().forward(embedding, t).unflatten(1, (-1, 3))


class ScaleDeformation(TwoLayer):
    """Phi_s: Delta s_i(t) from [e_i^s, t]. Zero at the start of training."""

    def __init__(self, embedding_dim: int, hidden: int) -> None:
        super().__init__(embedding_dim + 1, hidden, 6, zero_output=True)

    def forward(self, embedding: Tensor, t: float) -> Tensor:  # type: ignore[override]
        """[N, E] -> [N, 6]; s_i(t) = s_i * exp(Delta s_i), a sum in log space: it never turns negative."""
        return super().forward(embedding, t)
