"""Whether anchors ride on tracks of movers."""

from __future__ import annotations

from dataclasses import replace

from aa4d.cost.panel import Setup
from aa4d.cost.training import base, training_panel
from aa4d.methods.adaanchor4d.settings import AdaAnchor4DSettings
from aa4d.methods.settings import MotionSettings


def variants(setup: Setup) -> dict[str, AdaAnchor4DSettings]:
    settings = base(setup)
    usual = MotionSettings()
    # As short as the rest: the clean stage is half the coarse one by default.
    clean = min(usual.clean_iterations, max(settings.coarse_iterations // 2, 1))
    return {
        "none": settings,
        "tracks": replace(settings, motion=replace(usual, clean_iterations=clean)),
    }


PANEL = training_panel(
    "tracked movers",
    "Whether movers are found and anchors ride on their tracks (`--motion`); by default they do. Other panels train "
    "the paper's model, `none`.",
    variants,
    "tracks",
)
