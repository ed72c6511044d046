"""PSNR over the clip, as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from aa4d.files import whole_file

# Key in a frame's score, label, colour and line.
SERIES = (
    ("psnr", "held-out, whole image", "C0", "-"),
    ("psnr_still", "held-out, still pixels", "C2", "-"),
    ("psnr_dynamic", "held-out, moving pixels", "C1", "-"),
    ("psnr_dynamic_static", "held-out, moving pixels, coarse stage", "C1", ":"),
)


def psnr_figure(metrics: dict[str, Any]) -> Figure:
    """Every held-out frame, whole and split by motion, and training frames behind them."""
    figure = Figure(figsize=(8, 4), layout="constrained")
    axes = figure.add_subplot()
    training = metrics["training_frames"]
    axes.plot(
        [f["t"] for f in training],
        [f["psnr"] for f in training],
        "o",
        markersize=3,
        color="0.6",
        label="training frames",
    )
    for key, label, color, style in SERIES:
        points = [(f["t"], f[key]) for f in metrics["frames"] if f[key] is not None]
        if points:
            axes.plot(*zip(*points, strict=True), style, marker="o", markersize=4, color=color, label=label)
    axes.set(xlabel="t", ylabel="PSNR, dB")
    axes.grid(alpha=0.3)
    figure.legend(loc="outside lower center", ncols=3, fontsize=8)
    return figure


def plot_psnr(path: Path, metrics: dict[str, Any]) -> None:
    with whole_file(path) as temporary:
        psnr_figure(metrics).savefig(temporary, format="png", dpi=150)
