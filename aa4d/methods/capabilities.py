"""What some methods offer to layers and inspection, and others do not; a model is asked, never its method's name."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Protocol, runtime_checkable

from torch import Tensor

from aa4d.field.planes import FeaturePlanes


@runtime_checkable
class WeighsPlanes(Protocol):
    """Aggregates feature planes by weights."""

    def plane_weights(self, t: float) -> Tensor | None:
        """[N, 6] weights over the planes, mean over channels; None where this variant has none."""


@runtime_checkable
class WarpsCoordinates(Protocol):
    """Queries its planes at warped coordinates."""

    field: FeaturePlanes

    def warp_boundaries(self) -> Tensor:
        """[3, B + 1] where the map takes the edges of B equal bins of [-1, 1], on each axis."""


@runtime_checkable
class HasEvaluationCache(Protocol):
    """Draws faster from what it has stored beforehand: the same pictures, but for what the cache's name says."""

    def cached(self) -> AbstractContextManager[str]:
        """Fill the cache and draw from it while the context is open; its value names the cache."""
