"""Limits below which contributions are not added; the back ends are told, and have no such numbers of their own."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Cutoffs:
    """A Gaussian adds to a pixel where its alpha is at least `alpha`, until `transmittance` would be reached."""

    alpha: float
    transmittance: float


CUTOFFS = {"fast": Cutoffs(1 / 255, 1e-4), "exact": Cutoffs(1e-6, 1e-7)}
