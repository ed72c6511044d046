"""How the extension plays a model in Blender."""

from __future__ import annotations

from typing import Any

from aa4d.cost.panel import Measurement, Panel, Point, Quality, Setup
from aa4d.cost.playback import missing, playback_task


def points(result: dict[str, Any]) -> list[Point]:
    """Times are of the row of anchors; errors are those of the trained model between its frames."""
    times = next(row for row in result["rows"] if row["carrier"] == "anchors")
    live, baked = times["live_processor_ms"] / 1e3, times["baked_processor_ms"] / 1e3
    playing = live + (times["playing_processor_ms"] - times["exact_processor_ms"]) / 1e3
    found = [Point("live, at rest", live, times["live_ms"] / 1e3, 0.0)]
    for row in result["accuracy"]:
        more = {"99 %, mm": row["p99_mm"], "bake, s": row["bake_s"] or None}
        if row["what"].startswith("live"):
            known = row["keys"] > 1  # a short clip has no knots, between which playing would save the networks
            cost, wall = (playing, None) if known else (live, times["live_ms"] / 1e3)
            found.append(Point("live, playing", cost, wall, row["mean_mm"], is_default=True, more=more))
        else:
            found.append(Point(row["what"], baked, times["baked_ms"] / 1e3, row["mean_mm"], series="baked", more=more))
    return found


def measurements(setup: Setup) -> tuple[Measurement, ...]:
    return (Measurement(playback_task(setup), points),)


PANEL = Panel(
    title="Playback: live and baked",
    varied="Anchors evaluated at every frame, more cheaply while the timeline plays, or from keys; by default live.",
    measured="Times of a random model, Blender's own work included; errors of the trained model's visible anchors at "
    "every quarter of a frame against the exact evaluation; `addon/bench_addon.py`.",
    per="frame",
    quality=Quality("error of places, mean", "mm", -1),
    measurements=measurements,
    missing=missing,
)
