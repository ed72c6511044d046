"""What accuracy costs in time, over the whole product: panels of points, each measured in the run that reports it."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from aa4d.cost.panel import Panel

# The module of each, which has a `PANEL`; in the order of the report, which is that of the pipeline.
PANELS: dict[str, str] = {
    "raster-precision": "aa4d.cost.panels.raster_precision",
    "training-iterations": "aa4d.cost.panels.training_iterations",
}


def panel_of(name: str) -> Panel:
    panel: Panel = import_module(PANELS[name]).PANEL
    return panel
