"""The settings of a run, from what was given of them."""

from __future__ import annotations

from dataclasses import replace

from aa4d.methods import DEFAULT, METHODS, presets_of
from aa4d.methods.settings import AnchorSettings, MotionSettings, RunSettings
from aa4d.settings.given import Given


def given_settings(given: Given) -> RunSettings:
    """Method and preset first, then all that is given over it; anchors ride on movers where nothing says otherwise.

    Raises:
        InputError: names what is given wrongly, and where.
    """
    presets = presets_of(given.chosen("method", METHODS, DEFAULT))
    base = presets[given.chosen("preset", presets, "quick")]
    if isinstance(base, AnchorSettings):
        base = replace(base, motion=MotionSettings())
    return given.applied(base, chosen=["method", "preset"])
