"""What each effect adds to a frame."""

from __future__ import annotations

from typing import Any

from aa4d.cost.inputs import no_blender
from aa4d.cost.panel import Measurement, Panel, Point, Setup
from aa4d.cost.synthesis import synthesis_task

NONE = "none"


def points(result: dict[str, Any]) -> list[Point]:
    return [
        Point(
            row["effect"],
            row["picture_processor_s"] + row["truth_processor_s"],
            row["picture"] + row["truth"],
            None,
            row["effect"] == NONE,
            more={"picture, s": row["picture_processor_s"], "truth, s": row["truth_processor_s"]},
        )
        for row in result["effects"]
        if "picture" in row
    ]


def measurements(setup: Setup) -> tuple[Measurement, ...]:
    return (Measurement(synthesis_task(setup), points),)


PANEL = Panel(
    title="Synthesis: effects",
    varied="One effect after the other, alone, as a scene names it; by default there is none.",
    measured="Picture and truth of a frame, the least of two. What an effect is worth has no common measure.",
    per="frame",
    quality=None,
    measurements=measurements,
    missing=no_blender,
)
