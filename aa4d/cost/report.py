"""The report of `aa4d cost`: one HTML file that holds its plots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from aa4d.cost.panel import Panel
from aa4d.cost.rows import BETTER, Row, cost_of, span
from aa4d.reports import page
from aa4d.reports.page import Cell, Column, Links, Part, Section, Table, Text
from aa4d.reports.plot import Plot, Point, Series

TITLE = "What accuracy costs in time"
READ = (
    "Seconds of the processor are those of all threads together; other programs alter them less than those of the "
    "clock, which stand beside them. The default is a star, and bold in the table. The dashed line joins the points "
    "than which none is both cheaper and better."
)
LOG_SPAN = 20  # greatest over least cost, from which on a logarithm is easier to read
MOST_NAMED = 12  # points of a plot that are all named; of more, those that nothing beats


def write_page(path: Path, report: dict[str, Any], panels: Mapping[str, Panel]) -> None:
    """
    Args:
        report: the content of cost.json.
    """
    left_out, failed = report["left_out"], report["failed"]
    shown = {name: panel for name, panel in panels.items() if name not in left_out}
    absent = [Text(f"{panels[name].title}: {reason}") for name, reason in left_out.items()]
    sections = [
        Section("", [Text(READ, "note"), Links(tuple((panel.title, f"#{name}") for name, panel in shown.items()))]),
        Section("Left out", absent),
    ]
    for name, panel in shown.items():
        rows = [row for row in report["rows"] if row["panel"] == name]
        parts: list[Part] = [Text(f"Not measured: {sentence}", "warning") for sentence in failed.get(name, [])]
        if rows:
            parts += [table(panel, rows)] if panel.quality is None else [plot(panel, rows), table(panel, rows)]
        sections.append(Section(panel.title, parts, f"{panel.varied} {panel.measured}".replace("`", ""), anchor=name))
    page.write_page(path, TITLE, sections, lead=_lead(report))


def _lead(report: dict[str, Any]) -> str:
    """Where, when and how it was measured."""
    machine, load = report["machine"], report["load"]
    where = (
        f"aa4d {report['version']}, {report['date']}: {machine['processor']}, {machine['usable_threads']} of "
        f"{machine['threads']} threads, of which torch takes {machine['torch_threads']}, {machine['system']}, kernels "
        f"for {machine['instruction_set']}."
    )
    if load["load_before"] is not None:
        where += f" Load average {load['load_before']} before and {load['load_after']} after"
        if "least" in load:
            where += f"; at the beginning of measurements between {load['least']} and {load['greatest']}"
        where += "."
    coarse, fine = report["schedule"]
    capture = f" on the capture {report['capture']}" if report["capture"] else ""
    return (
        f"{where} Measured by aa4d cost --{report['size']}{capture} with {coarse} + {fine} iterations where these are "
        f"not what is varied; this session took {span(report['seconds'])}."
    )


def table(panel: Panel, rows: Sequence[Row]) -> Table:
    """A line for each choice, the default bold."""
    quality = panel.quality
    has_clock = any(row["wall_s"] is not None for row in rows)
    more = list(dict.fromkeys(key for row in rows for key in row["more"]))
    columns = [
        Column("choice", is_number=False),
        *([] if quality is None else [Column(quality.label, good=quality.better)]),
        Column(f"processor, a {panel.per}", good=-1),
        *([Column("clock", good=-1)] if has_clock else []),
        *(Column(key) for key in more),
    ]
    lines = []
    for row in rows:
        mark = "default" if row["default"] else ""
        lines.append(
            [
                Cell(row["label"], mark=mark, is_number=False),
                *([] if quality is None else [_number(row["quality"], mark)]),
                _seconds(row["processor_s"], mark),
                *([_seconds(row["wall_s"], mark)] if has_clock else []),
                *(_number(row["more"].get(key), mark) for key in more),
            ]
        )
    return Table(columns, lines)


def _seconds(value: float | None, mark: str) -> Cell:
    return Cell("" if value is None else span(value), value, mark)


def _number(value: Any, mark: str) -> Cell:
    """To four digits; a text as it is."""
    if value is None or isinstance(value, str | bool):
        return Cell("" if value is None else str(value), mark=mark)
    return Cell(f"{value:,}" if isinstance(value, int) else f"{value:.4g}", float(value), mark)


def plot(panel: Panel, rows: Sequence[Row]) -> Plot:
    """Quality over its cost."""
    assert panel.quality is not None
    rows = [row for row in rows if row["quality"] is not None]
    costs = [cost_of(panel, row["processor_s"], row["more"]) for row in rows]
    factor, unit = (1e3, "ms") if panel.across is None and max(costs, default=0) < 1 else (1.0, "s")
    at: dict[str, Point] = {
        row["label"]: (factor * cost, row["quality"]) for row, cost in zip(rows, costs, strict=True)
    }
    best = sorted((row for row in rows if row["on_front"]), key=lambda row: at[row["label"]][0])
    named = rows if len(rows) <= MOST_NAMED else best

    def series(name: str, some: Sequence[Row], **looks: Any) -> Series:
        notes = [f"{row['point']}, {row['cost']}, {row['quality']:.4g}" for row in some]
        return Series(name, [at[row["label"]] for row in some], notes=notes, **looks)

    drawn = []
    for name in dict.fromkeys(row["series"] for row in rows):
        own = [row for row in rows if row["series"] == name]
        labels = [row["point"] if row in named else "" for row in own]
        drawn.append(series(name or "choice", own, line=bool(name), labels=labels))
    if len(best) > 1:
        drawn.append(series("none is cheaper and better", best, line=True, dots=False, dashed=True, faint=True))
    if default := [row for row in rows if row["default"]]:
        drawn.append(series("default", default, star=True))
    positive = [x for x, _ in at.values() if x > 0]
    return Plot(
        f"{panel.quality.label} ({BETTER[panel.quality.better]} is better)",
        (panel.across or f"processor, {{}} a {panel.per}").format(unit),
        "",
        drawn,
        log_x=len(positive) == len(at) > 0 and max(positive) > LOG_SPAN * min(positive),
        log_y=panel.quality.is_log and all(y > 0 for _, y in at.values()),
    )
