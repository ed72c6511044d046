"""The report of `aa4d cost`: one HTML file that holds its plots."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aa4d.cost.panel import Panel
from aa4d.cost.rows import Row
from aa4d.files import write_text

LOG_SPAN = 20  # greatest over least time, from which on a logarithm is easier to read


def write_page(path: Path, report: dict[str, Any], panels: Mapping[str, Panel]) -> None:
    """
    Args:
        report: the content of cost.json.
    """
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined
    )
    rows = {name: [row for row in report["rows"] if row["panel"] == name] for name in panels}
    shown = [
        {
            "name": name,
            "panel": panel,
            "rows": rows[name],
            "more": list(dict.fromkeys(key for row in rows[name] for key in row["more"])),
            "plot": picture(figure(panel, rows[name])) if rows[name] else None,
            "failed": report["failed"].get(name, []),
        }
        for name, panel in panels.items()
        if name not in report["left_out"]
    ]
    left_out = [(panels[name].title, reason) for name, reason in report["left_out"].items()]
    html = environment.get_template("report.html.jinja").render(
        report=report, panels=shown, left_out=left_out, number=number, span=span
    )
    write_text(path, html)


def figure(panel: Panel, rows: list[Row]) -> Figure:
    """Quality over processor seconds: the default is a star, and the line of dots joins what nothing beats in both."""
    made = Figure(figsize=(6.4, 3.6), layout="constrained")
    axes = made.add_subplot()
    if panel.quality is None:
        _bars(axes, rows)
    else:
        _scatter(axes, panel, rows)
    axes.spines[["top", "right"]].set_visible(False)
    return made


def _bars(axes: Axes, rows: list[Row]) -> None:
    rows = rows[::-1]
    colors = ["#d9772b" if row["default"] else "#4c78a8" for row in rows]
    axes.barh([row["point"] for row in rows], [row["processor_s"] for row in rows], color=colors)
    axes.tick_params(axis="y", labelsize=7)
    axes.set_xlabel(f"processor seconds a {rows[0]['per']}; the default is orange")


def _scatter(axes: Axes, panel: Panel, rows: list[Row]) -> None:
    assert panel.quality is not None
    rows = [row for row in rows if row["quality"] is not None]
    for series in dict.fromkeys(row["series"] for row in rows):
        own = [row for row in rows if row["series"] == series]
        style = "o-" if series else "o"
        axes.plot(_x(own), _y(own), style, markersize=5, linewidth=1, alpha=0.8, label=series or None)
    best = sorted((row for row in rows if row["on_front"]), key=lambda row: row["processor_s"])
    axes.plot(_x(best), _y(best), ":", color="0.4", linewidth=1.2, label="nothing is cheaper and better")
    usual = [row for row in rows if row["default"]]
    axes.plot(_x(usual), _y(usual), "*", markersize=15, color="#d9772b", zorder=3, label="default")
    for row in rows:
        place = (row["processor_s"], row["quality"])
        axes.annotate(row["point"], place, textcoords="offset points", xytext=(5, 5), fontsize=7)
    seconds = [s for s in _x(rows) if s > 0]
    if seconds and max(seconds) > LOG_SPAN * min(seconds):
        axes.set_xscale("log")
    if panel.quality.is_log and all(value > 0 for value in _y(rows)):
        axes.set_yscale("log")
    axes.margins(0.12)
    better = {1: "higher is better", -1: "lower is better"}[panel.quality.better]
    axes.set(xlabel=f"processor seconds a {panel.per}", ylabel=f"{panel.quality.label}\n({better})")
    axes.legend(fontsize=7, frameon=False)


def _x(rows: list[Row]) -> list[float]:
    return [row["processor_s"] for row in rows]


def _y(rows: list[Row]) -> list[float]:
    return [row["quality"] for row in rows]


def picture(made: Figure) -> str:
    """A figure as a data URI, so that the names inside of one SVG mean nothing in another."""
    buffer = io.BytesIO()
    made.savefig(buffer, format="svg")
    return "data:image/svg+xml;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def number(value: Any) -> str:
    """To four digits; a text as it is."""
    if value is None:
        return ""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    return f"{value:,}" if isinstance(value, int) else f"{value:.4g}"


def span(seconds: float) -> str:
    """A time with its unit, to three digits."""
    units = (("h", 3600.0), ("min", 60.0), ("s", 1.0))
    unit, size = next(((u, size) for u, size in units if seconds >= size), ("ms", 1e-3))
    return f"{seconds / size:.3g} {unit}"
