"""In which arithmetic the networks are trained."""

from __future__ import annotations

from dataclasses import replace

from aa4d.cost.inputs import no_capture
from aa4d.cost.panel import Setup
from aa4d.cost.training import base, training_panel
from aa4d.methods.adaanchor4d.settings import AdaAnchor4DSettings

ARITHMETIC = ("float32", "bfloat16")


def missing(setup: Setup) -> str | None:
    return no_bfloat16(setup) or no_capture(setup)


def no_bfloat16(_setup: Setup) -> str | None:
    from aa4d import _native

    if _native.field.bfloat16_in_hardware():
        return None
    return "this processor has no bfloat16 products (AVX-512 BF16)"


def variants(setup: Setup) -> dict[str, AdaAnchor4DSettings]:
    return {name: replace(base(setup), arithmetic=name) for name in ARITHMETIC}


PANEL = training_panel(
    "arithmetic of networks",
    "The factors of the networks' products (`arithmetic`); by default float32.",
    variants,
    "float32",
    missing=missing,
)
