"""`aa4d eval`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from rich.table import Table
from tyro.conf import Positional, arg

from aa4d.console import console, step_progress


def evaluate(
    run: Annotated[Positional[Path], arg(help="Folder of a run, made by `aa4d train`.")],
    capture: Annotated[Path | None, arg(help="Capture folder, where it has moved since training.")] = None,
) -> None:
    """Score a run on the held-out frames and time its rendering; writes metrics.json."""
    from aa4d.evaluation.evaluate import evaluate as run_evaluation

    with step_progress("held-out frames") as progress:
        metrics = run_evaluation(run, capture, progress)
    console.print(metrics_table(metrics.as_json()))
    console.print(f"metrics: {run / 'metrics.json'}\nrenders: {run / 'eval'}")


def metrics_table(metrics: dict) -> Table:
    """Quality beside cost, the full model beside itself frozen at its coarse stage."""
    table = Table(title="held-out frames")
    table.add_column("")
    table.add_column("AdaAnchor4D", justify="right")
    table.add_column("coarse (static)", justify="right")

    def db(value: float | None) -> str:
        return "not measured" if value is None else f"{value:.2f} dB"

    table.add_row("PSNR", db(metrics["psnr"]), db(metrics["psnr_static"]))
    table.add_row("PSNR, moving pixels", db(metrics["psnr_dynamic"]), db(metrics["psnr_dynamic_static"]))
    table.add_row("SSIM", f"{metrics['ssim']:.4f}", "")
    width, height = metrics["resolution"]
    table.add_row("rendering", f"{metrics['fps']:.1f} fps at {width}x{height}, {metrics['threads']} thread(s)", "")
    table.add_row("training", f"{metrics['training_seconds']:.0f} s", "")
    table.add_row("anchors / Gaussians drawn", f"{metrics['anchors']} / {metrics['gaussians']}", "")
    table.add_row("neural size / model file", f"{metrics['neural_mib']:.2f} / {metrics['total_mib']:.2f} MiB", "")
    return table
