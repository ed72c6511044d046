"""How often cameras and points are adjusted together."""

from __future__ import annotations

from dataclasses import replace

from aa4d.cost.footage import USUAL, footage_panel

CHOICES = ((1, 3.0), (2, 1.5), (5, 1.1))  # refinements, and the growth after which there is another round


def label(refinements: int, grown_by: float) -> str:
    return f"{refinements} at every {100 * (grown_by - 1):.0f} %"


PANEL = footage_panel(
    "bundle adjustment",
    "How many refinements a round of bundle adjustment has, and after how much growth there is another; by default "
    f"{label(USUAL.global_refinements, USUAL.grown_by)} more.",
    {label(n, by): (1.0, replace(USUAL, global_refinements=n, grown_by=by)) for n, by in CHOICES},
    label(USUAL.global_refinements, USUAL.grown_by),
)
