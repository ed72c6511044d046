"""How many Gaussians an anchor has."""

from __future__ import annotations

from dataclasses import replace

from aa4d.cost.panel import Setup
from aa4d.cost.training import base, training_panel
from aa4d.methods.adaanchor4d.settings import AdaAnchor4DSettings

OFFSETS = (3, 5, 10, 16)


def variants(setup: Setup) -> dict[str, AdaAnchor4DSettings]:
    settings = base(setup)
    return {label(k): replace(settings, model=replace(settings.model, offsets=k)) for k in OFFSETS}


def label(k: int) -> str:
    return f"K = {k}"


PANEL = training_panel("K", "K, the Gaussians of an anchor (`model.offsets`); by default 10.", variants, label(10))
