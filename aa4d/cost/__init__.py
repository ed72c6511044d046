"""Costs of accuracy in time, over the whole product: panels of points, each measured in the run that reports it."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from aa4d.cost.panel import Panel

# The module of each, which has a `PANEL`; in the order of the report, which is that of the pipeline.
PANELS: dict[str, str] = {
    "synthesis-samples": "aa4d.cost.panels.synthesis_samples",
    "synthesis-traffic": "aa4d.cost.panels.synthesis_traffic",
    "synthesis-blur": "aa4d.cost.panels.synthesis_blur",
    "synthesis-effects": "aa4d.cost.panels.synthesis_effects",
    "footage-size": "aa4d.cost.panels.footage_size",
    "footage-window": "aa4d.cost.panels.footage_window",
    "footage-adjustment": "aa4d.cost.panels.footage_adjustment",
    "raster-precision": "aa4d.cost.panels.raster_precision",
    "network-precision": "aa4d.cost.panels.network_precision",
    "training-arithmetic": "aa4d.cost.panels.training_arithmetic",
    "training-iterations": "aa4d.cost.panels.training_iterations",
    "training-anchors": "aa4d.cost.panels.training_anchors",
    "training-offsets": "aa4d.cost.panels.training_offsets",
    "training-planes": "aa4d.cost.panels.training_planes",
    "training-levels": "aa4d.cost.panels.training_levels",
    "training-scale": "aa4d.cost.panels.training_scale",
    "training-threads": "aa4d.cost.panels.training_threads",
    "training-motion": "aa4d.cost.panels.training_motion",
    "training-methods": "aa4d.cost.panels.training_methods",
    "playback": "aa4d.cost.panels.playback",
    "playback-looks": "aa4d.cost.panels.playback_looks",
    "export-quantisation": "aa4d.cost.panels.export_quantisation",
    "export-formats": "aa4d.cost.panels.export_formats",
}


def panel_of(name: str) -> Panel:
    panel: Panel = import_module(PANELS[name]).PANEL
    return panel
