"""The rasteriser's precisions, on Gaussians strewn at random."""

from __future__ import annotations

from typing import Any

from aa4d.cost.kind import cost_task
from aa4d.cost.panel import Measurement, Panel, Point, Quality, Setup
from aa4d.graph.call import Call

DEFAULT = "fast"  # of `rasterize`


def measure(call: Call) -> dict[str, Any]:
    """A row for each precision."""
    from dataclasses import asdict

    from aa4d.raster.bench import measure_precisions

    return {"rows": [asdict(row) for row in measure_precisions(call.task.settings.given["repeats"])]}


def points(result: dict[str, Any]) -> list[Point]:
    return [
        Point(
            row["precision"],
            row["processor_ms"] / 1e3,
            (row["forward_ms"] + row["backward_ms"]) / 1e3,
            row["rms_error"],
            row["precision"] == DEFAULT,
            more={"largest error": row["largest_error"], "error of gradients": row["gradient_error"]},
        )
        for row in result["rows"]
    ]


def measurements(setup: Setup) -> tuple[Measurement, ...]:
    task = cost_task(__name__, "rasterizer precision", {"repeats": setup.size.repeats}, seconds=5)
    return (Measurement(task, points),)


PANEL = Panel(
    title="Rasterizer: precision",
    varied="Where contributions are cut off: alpha and transmittance; by default `fast`.",
    measured="10,000 random Gaussians at 480x270 for the time, 2,000 at 160x90 for the error against float64.",
    per="picture, forward and backward",
    quality=Quality("error of a picture, rms", "of 1", -1, is_log=True),
    measurements=measurements,
)
