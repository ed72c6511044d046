"""How the features of six planes become one: ACFA (paper, section 4.2) and the rivals of its ablation table."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from aa4d.errors import InputError
from aa4d.field.mlp import TwoLayer
from aa4d.field.planes import FeaturePlanes
from aa4d.kernels.plane_lookup import PLANES, look_up
from aa4d.methods.adaanchor4d.aggregations import AGGREGATIONS


class Aggregation(nn.Module):
    """One strategy. The same rule holds at every level; levels are concatenated, coarsest first.

    Args:
        embedding_dim: size E of e_i^acfa.
        hidden: width of Phi_w.
        channels: C, of a plane.
    """

    def __init__(self, embedding_dim: int, hidden: int, channels: int) -> None:  # noqa: ARG002
        super().__init__()
        self.channels = channels

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

    def __init__(self, embedding_dim: int, hidden: int, channels: int) -> None:
        super().__init__(embedding_dim, hidden, channels)
        self.predictor = TwoLayer(self.conditions(embedding_dim), hidden, len(PLANES) * channels, zero_output=True)

    @staticmethod
    def conditions(embedding_dim: int) -> int:
        """Width of what Phi_w is given."""
        raise NotImplementedError


class AnchorConditioned(Predicted):
    """ACFA: weights from the anchor's embedding and time."""

    @staticmethod
    def conditions(embedding_dim: int) -> int:
        return embedding_dim + 1

    def scores(self, embedding: Tensor, t: float) -> Tensor:
        return self.predictor(embedding, t).unflatten(1, (len(PLANES), -1))


class AnchorOnly(Predicted):
    """Weights from the anchor's embedding, the same at every time."""

    @staticmethod
    def conditions(embedding_dim: int) -> int:
        return embedding_dim

    def scores(self, embedding: Tensor, t: float) -> Tensor:  # noqa: ARG002
        return self.predictor(embedding).unflatten(1, (len(PLANES), -1))


class TimeOnly(Predicted):
    """Weights from time, the same for every anchor."""

    @staticmethod
    def conditions(embedding_dim: int) -> int:  # noqa: ARG004
        return 1

    def scores(self, embedding: Tensor, t: float) -> Tensor:
        of_all = self.predictor(embedding.new_full((1, 1), t)).unflatten(1, (len(PLANES), -1))
        return of_all.expand(len(embedding), -1, -1)


def make_aggregation(name: str, embedding_dim: int, hidden: int, channels: int) -> Aggregation:
    """Raises InputError for a name that is not in `AGGREGATIONS`."""
    if name not in AGGREGATIONS:
        raise InputError(f"aggregation {name!r} is unknown; choose one of {', '.join(AGGREGATIONS)}")
    strategy: type[Aggregation] = globals()[AGGREGATIONS[name]]
    return strategy(embedding_dim, hidden, channels)
