"""With how many threads is trained."""

from __future__ import annotations

import os
from typing import Any

from aa4d.cost.kind import cost_task
from aa4d.cost.panel import Measurement, Panel, Point, Quality, Setup
from aa4d.graph.call import Call


def measure(call: Call) -> dict[str, Any]:
    """An iteration of the fine stage on each number of threads."""
    import tempfile
    from pathlib import Path

    import torch

    from aa4d.cost.stopwatch import least
    from aa4d.methods import DEFAULT
    from aa4d.training.bench import CPU, STANDARD, prepare

    given, usual = call.task.settings.given, torch.get_num_threads()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        run, state = prepare(STANDARD, Path(folder), CPU, DEFAULT)

        def iterate() -> None:
            run.step(state)
            state.iteration += 1

        try:
            for threads in given["threads"]:
                torch.set_num_threads(threads)
                spent = least(iterate, 4 * given["repeats"], warm_up=3)
                rows.append({"threads": threads, "wall_s": spent.seconds, "processor_s": spent.processor_seconds})
        finally:
            torch.set_num_threads(usual)
    return {"rows": rows, "usual": usual}


def points(result: dict[str, Any]) -> list[Point]:
    return [
        Point(
            f"{row['threads']} thread{'s' if row['threads'] > 1 else ''}",
            row["processor_s"],
            row["wall_s"],
            1e3 * row["wall_s"],
            row["threads"] == result["usual"],
        )
        for row in result["rows"]
    ]


def measurements(setup: Setup) -> tuple[Measurement, ...]:
    most = os.cpu_count() or 1
    threads = sorted({most, *(2**n for n in range(10) if 2**n < most)})
    task = cost_task(__name__, "threads", {"threads": threads, "repeats": setup.size.repeats}, seconds=8)
    return (Measurement(task, points),)


PANEL = Panel(
    title="Training: threads",
    varied="Threads that compute, which give the same picture; by default as many as torch takes here.",
    measured="The least of the iterations of the fine stage, 5,000 anchors at 320x180, random pictures.",
    per="iteration",
    quality=Quality("iteration on the clock", "ms", -1),
    measurements=measurements,
)
