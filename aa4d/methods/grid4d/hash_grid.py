"""Feature grids of several resolutions over a unit cube, hashed where they are fine (Mueller et al. 2022)."""

from __future__ import annotations

import math
from itertools import product
from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor, nn
from torch.autograd.function import once_differentiable

# Of Teschner et al. 2003, as Instant-NGP takes them.
PRIMES = (1, 2_654_435_761, 805_459_861)
INITIAL_FEATURE = 1e-4  # largest value at the start

Sizes = tuple[int, int, int]


def level_sizes(coarsest: Sizes, finest: Sizes, levels: int) -> list[Sizes]:
    """Vertices along each axis, from level to level by equal factors."""
    steps = [level / max(levels - 1, 1) for level in range(levels)]
    along = [[math.ceil(a * (b / a) ** step - 1e-9) for step in steps] for a, b in zip(coarsest, finest, strict=True)]
    return list(zip(*along, strict=True))


def rows_of(size: Sizes, table: int) -> int:
    """Rows of a level's table: one a vertex, or 2^table."""
    return min(math.prod(size), 2**table)


class HashGrid(nn.Module):
    def __init__(self, sizes: list[Sizes], table: int, features: int) -> None:
        super().__init__()
        self.sizes, self.table = sizes, table
        self.levels = nn.ParameterList(
            nn.Parameter(torch.empty(rows_of(size, table), features).uniform_(-INITIAL_FEATURE, INITIAL_FEATURE))
            for size in sizes
        )

    def forward(self, x: Tensor) -> Tensor:
        """Features [N, L C] at x [N, 3]; outside of [0, 1], or where x is no number, those of the border.

        x learns nothing.
        """
        x = x.detach().nan_to_num(0).clamp(0, 1)
        return torch.cat([self._level(x, *level) for level in zip(self.sizes, self.levels, strict=True)], dim=1)

    def _level(self, x: Tensor, size: Sizes, rows: Tensor) -> Tensor:
        place = x * (x.new_tensor(size) - 1)
        low = torch.minimum(place.floor(), x.new_tensor(size) - 2)
        upper = place - low
        vertex = low.long()
        index, weight = [], []
        for corner in product((0, 1), repeat=3):
            index.append(self._row([vertex[:, axis] + corner[axis] for axis in range(3)], size))
            shares = [upper[:, axis] if corner[axis] else 1 - upper[:, axis] for axis in range(3)]
            weight.append(shares[0] * shares[1] * shares[2])
        found: Tensor = _WeightedRows.apply(rows, torch.stack(index, 1), torch.stack(weight, 1).to(rows.dtype))
        return found

    def _row(self, vertex: list[Tensor], size: Sizes) -> Tensor:
        """Of each vertex [N] in the level's table. Integers of 64 bits hold every product: sizes end at 2^16."""
        if math.prod(size) <= 2**self.table:
            return vertex[0] + size[0] * (vertex[1] + size[1] * vertex[2])
        mixed = vertex[0] * PRIMES[0] ^ vertex[1] * PRIMES[1] ^ vertex[2] * PRIMES[2]
        return mixed & (2**self.table - 1)


class _WeightedRows(torch.autograd.Function):
    """Weighted sums [N, C] of rows [R, C], each of eight with index and weight [N, 8].

    PyTorch's own backward pass of an embedding bag sorts the indices first, and takes nine times as long.
    """

    @staticmethod
    def forward(ctx: Any, rows: Tensor, index: Tensor, weight: Tensor) -> Tensor:
        ctx.save_for_backward(index, weight)
        ctx.rows = len(rows)
        return F.embedding_bag(index, rows, per_sample_weights=weight, mode="sum")

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None, None]:
        index, weight = ctx.saved_tensors
        columns = [
            gradient.new_zeros(ctx.rows).scatter_add_(0, index.flatten(), (weight * column[:, None]).flatten())
            for column in gradient.unbind(1)
        ]
        return torch.stack(columns, dim=1), None, None
