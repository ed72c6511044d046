"""A figure of scores against a knob: a panel for each score, a line for each variant."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from pathlib import Path

from aa4d.experiments.axis import Knob
from aa4d.experiments.kinds.evaluate import Row
from aa4d.files import whole_file
from aa4d.words import in_figure

SCORES = {"psnr": "PSNR, dB", "psnr_dynamic": "PSNR of moving pixels, dB", "ssim": "SSIM"}


def curve(rows: Sequence[Row], key: str) -> tuple[list[float], list[float], list[float]]:
    """Positions of the knob, mean scores there, and their standard deviations over seeds (0 of a single one)."""
    by_position: dict[float, list[float]] = {}
    for row in rows:
        if key in row:
            by_position.setdefault(float(row["at"]), []).append(float(row[key]))
    at = sorted(by_position)
    deviations = [statistics.stdev(by_position[x]) if len(by_position[x]) > 1 else 0.0 for x in at]
    return at, [statistics.fmean(by_position[x]) for x in at], deviations


def plot_against(knob: Knob, title: str, rows: Sequence[Row], path: Path) -> None:
    """
    Args:
        rows: with `at`, the knob's position, `variant`, `capture`, and scores.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    shown = {key: label for key, label in SCORES.items() if any(key in row for row in rows)}
    bases = list(dict.fromkeys(_base(row) for row in rows))
    lines = list(dict.fromkeys((_base(row), str(row["variant"])) for row in rows))
    figure = Figure(figsize=(4.2 * len(shown), 3.4), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, len(shown), squeeze=False)[0]
    for panel, (key, label) in zip(panels, shown.items(), strict=True):
        for base, variant in lines:
            here = [row for row in rows if (_base(row), str(row["variant"])) == (base, variant)]
            name = variant if len(bases) == 1 else f"{base}, {variant}"
            at, means, deviations = curve(here, key)
            panel.errorbar(at, means, yerr=deviations if any(deviations) else None, fmt="o-", markersize=4,
                           label=in_figure(name))  # fmt: skip
        panel.set_xlabel(in_figure(knob.label))
        panel.set_ylabel(label)
        panel.grid(alpha=0.3)
        if knob.log:
            panel.set_xscale("log")
    figure.suptitle(in_figure(title), fontsize=10)
    if len(lines) > 1:
        panels[0].legend(fontsize=8)
    with whole_file(path) as temporary:
        figure.savefig(temporary, format="png", dpi=110)


def _base(row: Row) -> str:
    """The scene's name without the position."""
    return str(row["capture"]).removesuffix(f" {row['at']:g}")
