"""How the features of six planes become one: ACFA (paper, section 4.2) and the rivals of its ablation table."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor, nn

from aa4d.errors import InputError
from aa4d.field.mlp import TwoLayer
from aa4d.field.planes import FeaturePlanes
from aa4d.kernels.plane_lookup import PLANES, look_up


class Aggregation(nn.Module):
    """One strategy. The same rule holds at every level; levels are concatenated, coarsest first."""

    def forward(self, field: FeaturePlanes, u: Tensor, embedding: Tensor, t: float) -> Tensor:
        """h_i(t) at the warped coordinates u [N, 3] with e_i^acfa [N, E]: [N, L * C]."""
        return look_up(field.in_order(), u, t, self.scores(embedding, t))

    def scores(self, embedding: Tensor, t: float) -> Tensor | None:
        """Z_i(t) [N, 6, C], whose softmax over the planes weighs them; None for the product of the planes."""
        raise NotImplementedError


class Product(Aggregation):
    """The Hadamard product of HexPlane and 4D-GS (paper, section 3): the baseline."""

    def scores(self, embedding: Tensor, t: float) -> None:  # noqa: ARG002
        return None


class Weighted(Aggregation):
    """A weighted sum over the planes."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.channels = channels

    def scores(self, embedding: Tensor, t: float) -> Tensor:
        """[N, E] -> [N, 6, C]"""
        raise NotImplementedError

    def weights(self, embedding: Tensor, t: float) -> Tensor:
        """w_{i,p,c}(t): [N, E] -> [N, 6, C]."""
        return torch.softmax(self.scores(embedding, t), dim=1)


class Mean(Weighted):
    """Uniform weights of 1/6: where the predicted ones start."""

    def scores(self, embedding: Tensor, t: float) -> Tensor:  # noqa: ARG002
        return embedding.new_zeros(len(embedding), len(PLANES), self.channels)


class Predicted(Weighted):
    """Weights by Phi_w. They start at 1/6: its output layer is zero."""

    def __init__(self, conditions: int, hidden: int, channels: int) -> None:
        super().__init__(channels)
        self.predictor = TwoLayer(conditions, hidden, len(PLANES) * channels, zero_output=True)


class AnchorConditioned(Predicted):
    """ACFA: weights from the anchor's embedding and time."""

    def __init__(self, embedding_dim: int, hidden: int, channels: int) -> None:
        super().__init__(embedding_dim + 1, hidden, channels)

    def scores(self, embedding: Tensor, t: float) -> Tensor:
        return self.predictor(embedding, t).unflatten(1, (len(PLANES), -1))


class AnchorOnly(Predicted):
    """Weights from the anchor's embedding, the same at every time."""

    def scores(self, embedding: Tensor, t: float) -> Tensor:  # noqa: ARG002
        return self.predictor(embedding).unflatten(1, (len(PLANES), -1))


class TimeOnly(Predicted):
    """Weights from time, the same for every anchor."""

    def __init__(self, hidden: int, channels: int) -> None:
        super().__init__(1, hidden, channels)

    def scores(self, embedding: Tensor, t: float) -> Tensor:
        of_all = self.predictor(embedding.new_full((1, 1), t)).unflatten(1, (len(PLANES), -1))
        return of_all.expand(len(embedding), -1, -1)


# From embedding size E, width of Phi_w's hidden layer, and channels C.
AGGREGATIONS: dict[str, Callable[[int, int, int], Aggregation]] = {
    "product": lambda _embedding_dim, _hidden, _channels: Product(),
    "mean": lambda _embedding_dim, _hidden, channels: Mean(channels),
    "anchor_only": AnchorOnly,
    "time_only": lambda _embedding_dim, hidden, channels: TimeOnly(hidden, channels),
    "acfa": AnchorConditioned,
}


def make_aggregation(name: str, embedding_dim: int, hidden: int, channels: int) -> Aggregation:
    """Raises InputError for a name that is not in `AGGREGATIONS`."""
    if name not in AGGREGATIONS:
        raise InputError(f"aggregation {name!r} is unknown; choose one of {', '.join(AGGREGATIONS)}")
    return AGGREGATIONS[name](embedding_dim, hidden, channels)
