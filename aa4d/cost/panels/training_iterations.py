"""How long is trained."""

from __future__ import annotations

from aa4d.cost.panel import Setup
from aa4d.cost.training import MEASURED, PRESET, training_panel
from aa4d.methods.adaanchor4d.settings import PRESETS, AdaAnchor4DSettings
from aa4d.methods.settings import with_iterations

SHARES = {"quick": (1 / 16, 1 / 8, 1 / 4, 1), "full": (1 / 8, 1 / 4, 1 / 2, 1)}  # shares of the default's
LONGER = {"quick": (), "full": ("standard", "paper")}  # presets


def variants(setup: Setup) -> dict[str, AdaAnchor4DSettings]:
    usual = PRESETS[PRESET]
    schedules = [
        with_iterations(usual, round(usual.coarse_iterations * share), round(usual.fine_iterations * share))
        for share in SHARES[setup.size.name]
    ]
    return {label(settings): settings for settings in [*schedules, *(PRESETS[n] for n in LONGER[setup.size.name])]}


def label(settings: AdaAnchor4DSettings) -> str:
    return f"{settings.coarse_iterations} + {settings.fine_iterations}"


PANEL = training_panel(
    "iterations",
    f"Iterations of the coarse and the fine stage; by default those of the preset {PRESET}.",
    variants,
    label(PRESETS[PRESET]),
    measured=MEASURED.replace(", with as many iterations as the top of the page says", ""),
)
