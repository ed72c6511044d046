"""Steps of the traffic simulation."""

from __future__ import annotations

from typing import Any

from aa4d.cost.inputs import no_blender
from aa4d.cost.panel import Measurement, Panel, Point, Quality, Setup
from aa4d.cost.synthesis import synthesis_task

DEFAULT_S = 0.02


def points(result: dict[str, Any]) -> list[Point]:
    return [
        Point(
            f"{row['step_s']:g} s",
            row["processor_s"],
            row["seconds"],
            row["worst_m"],
            row["step_s"] == DEFAULT_S,
            series="step",
            more={"mean error, m": row["mean_m"]},
        )
        for row in result["traffic"]
        if "worst_m" in row
    ]


def measurements(setup: Setup) -> tuple[Measurement, ...]:
    return (Measurement(synthesis_task(setup), points),)


PANEL = Panel(
    title="Synthesis: traffic step",
    varied=f"The time step of the traffic simulation (`traffic.step_s`); by default {DEFAULT_S:g} s.",
    measured="All vehicles over the clip, against a step of 0.001 s; steps in which vehicles collide are left out.",
    per="clip",
    quality=Quality("worst error of a position", "m", -1, is_log=True),
    measurements=measurements,
    missing=no_blender,
)
