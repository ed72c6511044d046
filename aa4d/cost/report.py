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

from aa4d.cost.panel import Panel, Quality
from aa4d.cost.rows import BETTER, Row, cost_of, span
from aa4d.files import write_text

LOG_SPAN = 20  # greatest over least cost, from which on a logarithm is easier to read
MOST_NAMED = 12  # points of a plot that are all named; of more, those that nothing beats
DEFAULT, OTHER = "#d9772b", "#4c78a8"


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
            "clock": any(row["wall_s"] is not None for row in rows[name]),
            "more": list(dict.fromkeys(key for row in rows[name] for key in row["more"])),
            "plot": picture(figure(panel, rows[name])) if rows[name] else None,
            "failed": report["failed"].get(name, []),
        }
        for name, panel in panels.items()
        if name not in report["left_out"]
    ]
    left_out = [(panels[name].title, reason) for name, reason in report["left_out"].items()]
    html = environment.get_template("report.html.jinja").render(
        report=report, panels=shown, left_out=left_out, number=number, span=span, parts=parts
    )
    write_text(path, html)


def figure(panel: Panel, rows: list[Row]) -> Figure:
    """Quality over its cost: the default is a star, and the dotted line joins what nothing beats in both."""
    made = Figure(figsize=(6.4, 3.6), layout="constrained")
    axes = made.add_subplot()
    per = panel.across or f"processor, {{}} a {panel.per}"
    times = [cost_of(panel, row["processor_s"], row["more"]) for row in rows]
    factor, unit = (1e3, "ms") if panel.across is None and max(times) < 1 else (1.0, "s")
    costs = {row["label"]: factor * cost for row, cost in zip(rows, times, strict=True)}
    if panel.quality is None:
        _bars(axes, rows, costs)
    else:
        _scatter(axes, panel.quality, [row for row in rows if row["quality"] is not None], costs)
    axes.set_xlabel(per.format(unit))
    axes.spines[["top", "right"]].set_visible(False)
    return made


def _bars(axes: Axes, rows: list[Row], costs: dict[str, float]) -> None:
    labels = [row["label"] for row in reversed(rows)]
    colors = [DEFAULT if row["default"] else OTHER for row in reversed(rows)]
    axes.barh(labels, [costs[label] for label in labels], color=colors)
    axes.tick_params(axis="y", labelsize=7)


def _scatter(axes: Axes, quality: Quality, rows: list[Row], costs: dict[str, float]) -> None:
    def plot(some: list[Row], style: str, **looks: Any) -> None:
        axes.plot([costs[row["label"]] for row in some], [row["quality"] for row in some], style, **looks)

    for series in dict.fromkeys(row["series"] for row in rows):
        own = [row for row in rows if row["series"] == series]
        plot(own, "o-" if series else "o", markersize=5, linewidth=1, alpha=0.8, label=series or None)
    best = sorted((row for row in rows if row["on_front"]), key=lambda row: costs[row["label"]])
    if len(best) > 1:
        plot(best, ":", color="0.4", linewidth=1.2, label="none is cheaper and better")
    plot([row for row in rows if row["default"]], "*", markersize=15, color=DEFAULT, zorder=3, label="default")
    for row in rows if len(rows) <= MOST_NAMED else best:
        place = (costs[row["label"]], row["quality"])
        axes.annotate(row["point"], place, textcoords="offset points", xytext=(5, 5), fontsize=7)
    shown = [costs[row["label"]] for row in rows]
    if min(shown) > 0 and max(shown) > LOG_SPAN * min(shown):
        axes.set_xscale("log")
    if quality.is_log and all(row["quality"] > 0 for row in rows):
        axes.set_yscale("log")
    axes.margins(0.12)
    axes.set_ylabel(f"{quality.label}\n({BETTER[quality.better]} is better)")
    axes.legend(fontsize=7, frameon=False)


def picture(made: Figure) -> str:
    """A figure as a data URI, so that the names inside of one SVG mean nothing in another."""
    buffer = io.BytesIO()
    made.savefig(buffer, format="svg")
    return "data:image/svg+xml;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def parts(text: str) -> list[str]:
    """A text cut at its backticks: every second part is code."""
    return text.split("`")


def number(value: Any) -> str:
    """To four digits; a text as it is."""
    if value is None:
        return ""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    return f"{value:,}" if isinstance(value, int) else f"{value:.4g}"
