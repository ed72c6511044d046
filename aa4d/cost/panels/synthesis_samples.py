"""Samples and denoising of rendered frames."""

from __future__ import annotations

from typing import Any

from aa4d.cost.inputs import no_blender
from aa4d.cost.panel import Measurement, Panel, Point, Quality, Setup
from aa4d.cost.synthesis import synthesis_task

DEFAULT = (16, True)  # samples and denoising of a scene file that names neither


def points(result: dict[str, Any]) -> list[Point]:
    return [
        Point(
            f"{row['samples']}",
            row["processor_s"],
            row["seconds"],
            row["psnr_db"],
            (row["samples"], row["denoise"]) == DEFAULT,
            series="denoised" if row["denoise"] else "raw",
            more={"flicker, of 255": row["flicker"]},
        )
        for row in result["render"]
        if "psnr_db" in row
    ]


def measurements(setup: Setup) -> tuple[Measurement, ...]:
    return (Measurement(synthesis_task(setup), points),)


PANEL = Panel(
    title="Synthesis: samples and denoising",
    varied="Samples of a pixel, and whether the frame is denoised; by default 16, denoised.",
    measured="A frame of the scene, against one of many more samples, raw; `aa4d synth cost`.",
    per="frame",
    quality=Quality("PSNR against the reference", "dB", 1),
    measurements=measurements,
    missing=no_blender,
)
