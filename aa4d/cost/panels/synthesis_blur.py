"""Pieces of motion that a blurred frame is made of."""

from __future__ import annotations

from typing import Any

from aa4d.cost.inputs import no_blender
from aa4d.cost.panel import Measurement, Panel, Point, Quality, Setup
from aa4d.cost.synthesis import synthesis_task

DEFAULT = 1  # of synth/effects/motion_blur.py


def points(result: dict[str, Any]) -> list[Point]:
    return [
        Point(
            f"{2 ** row['steps']}",
            row["processor_s"],
            row["seconds"],
            row["psnr_db"],
            row["steps"] == DEFAULT,
            series="pieces",
        )
        for row in result["motion_blur"]
    ]


def measurements(setup: Setup) -> tuple[Measurement, ...]:
    return (Measurement(synthesis_task(setup), points),)


PANEL = Panel(
    title="Synthesis: motion blur",
    varied="Straight pieces that the motion during an exposure is made of, a power of two "
    "(`effects.motion_blur.steps`); by default 2.",
    measured="A frame of 64 samples at an exposure of half a frame, against 32 pieces by the same seed.",
    per="frame",
    quality=Quality("PSNR against the reference", "dB", 1),
    measurements=measurements,
    missing=no_blender,
)
