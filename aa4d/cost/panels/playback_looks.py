"""What the extension's looks cost to render, and how near they come to the trained picture."""

from __future__ import annotations

from typing import Any

from aa4d.cost.panel import Measurement, Panel, Point, Quality, Setup
from aa4d.cost.playback import missing, playback_task

USUAL = ("Native Splats", "Gaussians")  # the look of a new import: the first that this Blender has


def points(result: dict[str, Any]) -> list[Point]:
    usual = next(look for look in USUAL if any(row["look"] == look for row in result["pictures"]))
    return [
        Point(_label(row), row["processor_s"], None, row["db"], is_default=_label(row) == usual)
        for row in result["pictures"]
    ]


def _label(row: dict[str, Any]) -> str:
    parts = [row["look"]]
    if row["trained_picture"] == "yes":
        parts.append("Trained Picture")
    if row["seen_from"] == "frozen":
        parts.append("seen from one place")
    if row["harmonics"]:
        parts.append(f"harmonics of degree {row['harmonics']}")
    return ", ".join(parts)


def measurements(setup: Setup) -> tuple[Measurement, ...]:
    return (Measurement(playback_task(setup), points),)


PANEL = Panel(
    title="Playback: looks",
    varied="Gaussians as ellipsoids or as the splats that newer Blenders draw themselves (left out where they cannot), "
    "as they are or with Trained Picture.",
    measured="Held-out frames rendered by Cycles, against those that evaluation drew; the processor's time alone.",
    per="frame",
    quality=Quality("PSNR against our rasterizer", "dB", 1),
    measurements=measurements,
    missing=missing,
)
