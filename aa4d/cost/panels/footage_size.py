"""The size of the pictures that features are found in."""

from __future__ import annotations

from aa4d.cost.footage import USUAL, footage_panel

SHARES = {"half": 0.5, "three quarters": 0.75, "whole": 1.0}

PANEL = footage_panel(
    "frame size",
    "The size of the pictures that features are found in; by default whole, for frames of up to "
    f"{USUAL.longest_px} px.",
    {label: (share, USUAL) for label, share in SHARES.items()},
    "whole",
)
