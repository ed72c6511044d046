"""How many levels the feature planes have."""

from __future__ import annotations

from dataclasses import replace

from aa4d.cost.panel import Setup
from aa4d.cost.training import base, training_panel
from aa4d.methods.adaanchor4d.settings import AdaAnchor4DSettings

LEVELS = ((128,), (64, 128), (32, 64, 128))


def variants(setup: Setup) -> dict[str, AdaAnchor4DSettings]:
    settings = base(setup)
    return {label(r): replace(settings, model=replace(settings.model, spatial_resolutions=r)) for r in LEVELS}


def label(resolutions: tuple[int, ...]) -> str:
    return f"{len(resolutions)} level{'s' if len(resolutions) > 1 else ''}"


PANEL = training_panel(
    "plane levels",
    "Levels of the planes, of which the finest has 128 cells a side and each further one half as many; by default two.",
    variants,
    label((64, 128)),
)
