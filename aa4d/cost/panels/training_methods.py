"""Which method is trained."""

from __future__ import annotations

from aa4d.cost.panel import Setup
from aa4d.cost.training import PRESET, training_panel
from aa4d.methods import DEFAULT, METHODS, presets_of, title_of
from aa4d.methods.settings import RunSettings, with_iterations


def variants(setup: Setup) -> dict[str, RunSettings]:
    return {title_of(name): with_iterations(presets_of(name)[PRESET], *setup.size.schedule) for name in METHODS}


PANEL = training_panel(
    "methods",
    f"The method, each with its preset {PRESET}; by default {title_of(DEFAULT)}.",
    variants,
    title_of(DEFAULT),
)
