"""The canonical anchors: what each of them owns (paper, section 3)."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import KDTree
from torch import Tensor, nn

EMBEDDINGS = ("embedding_acfa", "embedding_offset", "embedding_scale")
OPTIONAL = (*EMBEDDINGS, "dynamics")  # what a method may let its anchors own besides


class Anchors(nn.Module):
    """N anchors: centre, feature, K offsets, six log scales, and the embeddings or dynamics that a method reads.

    Centres are fixed, as in Scaffold-GS: offsets carry the geometry, and the field's query coordinates stay put.
    """

    position: Tensor  # [N, 3] model frame, or the frame of the anchor's group (aa4d/motion/groups.py)
    group: Tensor | None  # [N] int64, -1 for the world; None where nothing rides
    dynamics: nn.Parameter | None  # [N, 2] logits of MoDec-GS's gates

    def __init__(
        self,
        position: Tensor,  # [N, 3]
        log_scale: Tensor,  # [N, 6]
        offsets: int,
        feature_dim: int,
        embedding_dim: int,
        *,
        embeddings: tuple[str, ...] = EMBEDDINGS,
        embedding_std: float = 0.0,
    ) -> None:
        """`embeddings`: those of `OPTIONAL` that the model reads, all `embedding_dim` wide; the others are None. They
        start at N(0, `embedding_std`)."""
        super().__init__()
        n = len(position)
        self.register_buffer("position", position)
        self.register_buffer("group", None)
        self.feature = nn.Parameter(torch.zeros(n, feature_dim))
        self.offset = nn.Parameter(torch.zeros(n, offsets, 3))
        self.log_scale = nn.Parameter(log_scale)
        for name in OPTIONAL:
            owned = nn.Parameter(embedding_std * torch.randn(n, embedding_dim)) if name in embeddings else None
            self.register_parameter(name, owned)

    def __len__(self) -> int:
        return len(self.position)

    def more(self, position: Tensor, log_scale: Tensor, embedding_std: float) -> Anchors:
        """Other anchors [M] that own the same, at the start: positions [M, 3], log scales [M, 6]."""
        owned = [name for name in OPTIONAL if getattr(self, name) is not None]
        width = getattr(self, owned[0]).shape[1] if owned else 0
        return Anchors(
            position,
            log_scale,
            self.offset.shape[1],
            self.feature.shape[1],
            width,
            embeddings=tuple(owned),
            embedding_std=embedding_std,
        )

    def rows(self, index: Tensor | None = None) -> AnchorRows:
        """All anchors, or those at `index` [M]."""
        owned = {field.name: getattr(self, field.name) for field in fields(AnchorRows)}
        if index is not None:
            owned = {name: None if v is None else v.index_select(0, index) for name, v in owned.items()}
        return AnchorRows(**owned)


@dataclass(frozen=True)
class AnchorRows:
    """What some of the anchors own, as in `Anchors`."""

    position: Tensor
    group: Tensor | None
    feature: Tensor
    offset: Tensor
    log_scale: Tensor
    embedding_acfa: Tensor
    embedding_offset: Tensor | None  # None without DLGD
    embedding_scale: Tensor | None
    dynamics: Tensor | None  # [N, 2] logits of MoDec-GS's gates


def voxel_centres(points: NDArray[np.float64], voxel: float) -> NDArray[np.float64]:
    """One centre for each occupied voxel, [M, 3], in a fixed order."""
    return np.unique(np.round(points / voxel), axis=0) * voxel


def spacing(position: NDArray[np.float64], floor: float) -> NDArray[np.float64]:
    """Root mean squared distance to the three nearest neighbours, at least `floor`: duplicates give no -inf log."""
    neighbours = min(3, len(position) - 1)
    if neighbours < 1:
        return np.full(len(position), floor)
    distance, _ = KDTree(position).query(position, k=neighbours + 1)
    return np.maximum(np.sqrt(np.square(distance[:, 1:]).mean(axis=1)), floor)
