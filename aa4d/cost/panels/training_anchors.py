"""How many anchors a training begins with and may grow."""

from __future__ import annotations

from dataclasses import replace

from aa4d.cost.panel import Setup
from aa4d.cost.training import base, training_panel
from aa4d.methods.adaanchor4d.settings import AdaAnchor4DSettings

VOXELS_PX = (12.0, 8.0, 5.0, 3.5)


def variants(setup: Setup) -> dict[str, AdaAnchor4DSettings]:
    return {label(voxel_px): replace(base(setup), voxel_px=voxel_px) for voxel_px in VOXELS_PX}


def label(voxel_px: float) -> str:
    return f"{voxel_px:g} px"


PANEL = training_panel(
    "anchors",
    "The edge of the voxels that anchors begin in (`voxel_px`); by default 5 px. The table has the number of anchors.",
    variants,
    label(5.0),
)
