"""A panel of closed-form numbers: error = 1 / seconds, and one point that another beats in both."""

from __future__ import annotations

from typing import Any

from aa4d.cost.kind import cost_task
from aa4d.cost.panel import Measurement, Panel, Point, Quality, Setup
from aa4d.errors import InputError
from aa4d.graph.call import Call

SECONDS = (0.1, 1.0, 4.0)
ran: list[float] = []


def measure(call: Call) -> dict[str, Any]:
    seconds = call.task.settings.given["seconds"]
    ran.append(seconds)
    if seconds < 0:
        raise InputError("time runs forwards; give it a positive number")
    return {"seconds": seconds, "error": 1 / seconds}


def points(result: dict[str, Any]) -> list[Point]:
    seconds, error = result["seconds"], result["error"]
    found = [Point(f"{seconds:g} s", seconds, 2 * seconds, error, seconds == 1, more={"inverse": 1 / error})]
    return [*found, Point("wasteful", 2.0, 2.0, 1.5)] if seconds == 1 else found


def measurements(_setup: Setup) -> tuple[Measurement, ...]:
    tasks = (cost_task(__name__, f"{s:g}", {"seconds": s}, seconds=s) for s in SECONDS)
    return tuple(Measurement(task, points) for task in tasks)


def failing(setup: Setup) -> tuple[Measurement, ...]:
    broken = cost_task(__name__, "backwards", {"seconds": -1.0}, seconds=1)
    return (*measurements(setup), Measurement(broken, points))


PANEL = Panel("Hyperbola", "How long is waited.", "By hand.", "wait", Quality("error", "m", -1, True), measurements)
