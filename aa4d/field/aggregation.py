"""How the features of six planes become one: ACFA (paper, section 4.2) and the rivals of its ablation table."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor, nn

from aa4d.errors import InputError
from aa4d.field.mlp import TwoLayer, with_time
from aa4d.field.planes import PLANES


class Aggregation(nn.Module):
    """One strategy. The same rule holds at every level; levels are concatenated, coarsest first."""

    def forward(self, features: Tensor, embedding: Tensor, t: float) -> Tensor:
        """h_i(t) from the plane features [L, N, 6, C] and e_i^acfa [N, E]: [N, L * C]."""
        return self.combine(features, embedding, t).transpose(0, 1).flatten(1)

    def combine(self, features: Tensor, embedding: Tensor, t: float) -> Tensor:
        """[L, N, 6, C], [N, E] -> [L, N, C]"""
        raise NotImplementedError


class Product(Aggregation):
    """The Hadamard product of HexPlane and 4D-GS (paper, section 3): the baseline."""

    def combine(self, features: Tensor, embedding: Tensor, t: float) -> Tensor:  # noqa: ARG002
        return features.prod(dim=2)


class Mean(Aggregation):
    """Uniform weights of 1/6: where every weighted strategy starts."""

    def combine(self, features: Tensor, embedding: Tensor, t: float) -> Tensor:  # noqa: ARG002
        return features.mean(dim=2)


class Weighted(Aggregation):
    """Phi_w and the weighted sum over planes. Starts at uniform weights 1/6: its output layer is zero."""

    def __init__(self, conditions: int, hidden: int, channels: int) -> None:
        super().__init__()
        self.predictor = TwoLayer(conditions, hidden, len(PLANES) * channels, zero_output=True)

    def condition(self, embedding: Tensor, t: float) -> Tensor:
        """What Phi_w sees of each anchor: [N, E] -> [N, conditions]."""
        raise NotImplementedError

    def weights(self, embedding: Tensor, t: float) -> Tensor:
        """w_{i,p,c}(t): softmax over the planes of Phi_w's scores; [N, E] -> [N, 6, C]."""
        scores = self.predictor(self.condition(embedding, t))
        return torch.softmax(scores.view(len(embedding), len(PLANES), -1), dim=1)

    def combine(self, features: Tensor, embedding: Tensor, t: float) -> Tensor:
        return (self.weights(embedding, t) * features).sum(dim=2)


class AnchorConditioned(Weighted):
    """ACFA: weights from the anchor's embedding and time."""

    def __init__(self, embedding_dim: int, hidden: int, channels: int) -> None:
        super().__init__(embedding_dim + 1, hidden, channels)

    def condition(self, embedding: Tensor, t: float) -> Tensor:
        return with_time(embedding, t)


class AnchorOnly(Weighted):
    """Weights from the anchor's embedding, the same at every time."""

    def __init__(self, embedding_dim: int, hidden: int, channels: int) -> None:
        super().__init__(embedding_dim, hidden, channels)

    def condition(self, embedding: Tensor, t: float) -> Tensor:  # noqa: ARG002
        return embedding


class TimeOnly(Weighted):
    """Weights from time, the same for every anchor."""

    def __init__(self, embedding_dim: int, hidden: int, channels: int) -> None:  # noqa: ARG002
        super().__init__(1, hidden, channels)

    def condition(self, embedding: Tensor, t: float) -> Tensor:
        return embedding.new_full((len(embedding), 1), t)


# From embedding size E, width of Phi_w's hidden layer, and channels C.
AGGREGATIONS: dict[str, Callable[[int, int, int], Aggregation]] = {
    "product": lambda *_: Product(),
    "mean": lambda *_: Mean(),
    "anchor_only": AnchorOnly,
    "time_only": TimeOnly,
    "acfa": AnchorConditioned,
}


def make_aggregation(name: str, embedding_dim: int, hidden: int, channels: int) -> Aggregation:
    """Raises InputError for a name that is not in `AGGREGATIONS`."""
    if name not in AGGREGATIONS:
        raise InputError(f"aggregation {name!r} is unknown; choose one of {', '.join(AGGREGATIONS)}")
    return AGGREGATIONS[name](embedding_dim, hidden, channels)
