"""How fine the feature planes are."""

from __future__ import annotations

from dataclasses import replace

from aa4d.cost.panel import Setup
from aa4d.cost.training import base, training_panel
from aa4d.methods.adaanchor4d.settings import AdaAnchor4DSettings

RESOLUTIONS = ((16, 32), (32, 64), (64, 128), (128, 256))


def variants(setup: Setup) -> dict[str, AdaAnchor4DSettings]:
    settings = base(setup)
    return {label(r): replace(settings, model=replace(settings.model, spatial_resolutions=r)) for r in RESOLUTIONS}


def label(resolutions: tuple[int, ...]) -> str:
    return ", ".join(map(str, resolutions))


PANEL = training_panel(
    "plane resolution",
    "Cells along a side of the spatial planes (`model.spatial_resolutions`), two levels; by default 64 and 128.",
    variants,
    label((64, 128)),
)
