"""Panels of trainings that differ in one setting, scored on held-out frames."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from aa4d.cost.inputs import no_capture, scored
from aa4d.cost.panel import Measurement, Panel, Point, Quality, Setup
from aa4d.methods.adaanchor4d.settings import PRESETS, AdaAnchor4DSettings
from aa4d.methods.settings import RunSettings, with_iterations

PSNR = Quality("PSNR of held-out frames", "dB", 1)
MEASURED = (
    "The paper's model by the preset `quick`, with as many iterations as the top of the page says; seconds are those "
    "of the training loop, PSNR that of every 8th frame, which training never saw."
)
PRESET = "quick"


def base(setup: Setup) -> AdaAnchor4DSettings:
    """What trainings start from that vary something other than their length."""
    return with_iterations(PRESETS[PRESET], *setup.size.schedule)


def points(label: str, is_default: bool, result: dict[str, Any]) -> list[Point]:
    """From the result of an evaluation."""
    return [
        Point(
            label,
            result["training_processor_seconds"],
            result["training_seconds"],
            result["psnr"],
            is_default,
            more={
                "PSNR, moving pixels": result.get("psnr_dynamic"),
                "units": result["anchors"],
                "model, MiB": result["total_mib"],
                "frames a second": result["fps"],
            },
        )
    ]


def measurements(
    title: str, variants: Callable[[Setup], Mapping[str, RunSettings]], default: str, setup: Setup
) -> tuple[Measurement, ...]:
    return tuple(
        Measurement(scored(setup, f"{title}, {label}", settings), partial(points, label, label == default))
        for label, settings in variants(setup).items()
    )


def training_panel(
    title: str,
    varied: str,
    variants: Callable[[Setup], Mapping[str, RunSettings]],
    default: str,
    *,
    measured: str = MEASURED,
    missing: Callable[[Setup], str | None] = no_capture,
) -> Panel:
    """A panel whose points are the `variants`, settings by label, of which one is the `default`."""
    return Panel(
        f"Training: {title}",
        varied,
        measured,
        "training",
        PSNR,
        partial(measurements, title, variants, default),
        missing,
    )
