"""With how many frames each one is matched."""

from __future__ import annotations

from dataclasses import replace

from aa4d.cost.footage import USUAL, footage_panel

WINDOWS = (1, 3, 8)


def label(window: int) -> str:
    return f"{window} next" if window > 1 else "the next"


PANEL = footage_panel(
    "matching window",
    f"How many frames after it a frame is matched with, besides some further away; by default {USUAL.window}.",
    {label(window): (1.0, replace(USUAL, window=window)) for window in WINDOWS},
    label(USUAL.window),
)
