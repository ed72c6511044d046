"""The networks' kernels and their torch twins in every arithmetic."""

from __future__ import annotations

from typing import Any

from aa4d.cost.kind import cost_task
from aa4d.cost.panel import Measurement, Panel, Point, Quality, Setup
from aa4d.graph.call import Call

NETWORKS = "networks: "  # what the subjects' names begin with


def measure(call: Call) -> dict[str, Any]:
    """Rows of the precision ladder, those of networks."""
    from dataclasses import asdict

    import torch

    from aa4d.stress.precision import measure as measured
    from aa4d.stress.precision import subjects

    usual = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        chosen = [subject for subject in subjects() if subject.name.startswith(NETWORKS)]
        rows = []
        for number, subject in enumerate(chosen):
            rows += [asdict(row) for row in measured(subject, call.task.settings.given["repeats"])]
            call.advance(number + 1, len(chosen))
    finally:
        torch.set_num_threads(usual)
    return {"rows": rows}


def points(result: dict[str, Any]) -> list[Point]:
    """All networks together: the sum of their times and the worst of their errors."""
    ways: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for row in result["rows"]:
        ways.setdefault((row["arithmetic"], row["by"]), []).append(row)
    return [
        Point(
            f"{arithmetic}, {by}",
            sum(row["ms"] for row in rows) / 1e3,
            None,
            max(row["gradient_error"] for row in rows) or None,  # of float64 it is 0, by which all is measured
            (arithmetic, by) == ("float32", "kernel"),
            more={"error of values": max(row["value_error"] for row in rows)},
        )
        for (arithmetic, by), rows in ways.items()
        if all(row["gradient_error"] is not None for row in rows)  # None where something is not finite
    ]


def measurements(setup: Setup) -> tuple[Measurement, ...]:
    task = cost_task(__name__, "arithmetic of kernels", {"repeats": setup.size.repeats}, seconds=10)
    return (Measurement(task, points),)


PANEL = Panel(
    title="Arithmetic: the networks' kernels",
    varied="Float64, float32, bfloat16, by the fused kernel or its torch twin; by default the kernel in float32.",
    measured="All networks of 4,000 anchors on one thread, the processor's time alone; the worst error relative to "
    "float64, of which the table has the time.",
    per="forward and backward pass",
    quality=Quality("error of gradients", "", -1, is_log=True),
    measurements=measurements,
)
