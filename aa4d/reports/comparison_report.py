"""The report of a comparison of methods: its tables, quality against cost, and the same frames by every method."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from aa4d.errors import InputError
from aa4d.experiments.comparison import TRACKED
from aa4d.experiments.comparison_tables import POOLED, Comparison, Failure, Mean, Score, table_of
from aa4d.experiments.pareto import ACROSS, LABELS, SPAN_DB, UP, front
from aa4d.files import read_json_object
from aa4d.methods import DEFAULT
from aa4d.reports.fitting import Page, links_to
from aa4d.reports.page import Cell, Column, Part, Section, Table, Text
from aa4d.reports.pictures import Detail
from aa4d.reports.plot import Plot, Series
from aa4d.reports.results import digest_of_runs, every_run, histories, pictured, runs_of
from aa4d.reports.scored import Captures
from aa4d.words import counted

COMPARISON = "compare.json"
LINKED = ("compare.md", "table.csv", "rows.csv", "pareto.png", COMPARISON)


def comparison_page(folder: Path, captures: Captures) -> Page:
    """Raises InputError where the comparison is damaged or empty."""
    comparison = read_comparison(folder / COMPARISON)
    runs = runs_of(folder, comparison.rows)
    means, pooled, titles = comparison.means(), comparison.pooled(), comparison.titles
    tables: list[Part] = []
    if len(comparison.pooled_over()) > 1:
        tables.append(_table(comparison, pooled, f"{POOLED}, mean over those that have the score"))
    for capture in comparison.captures:
        here = [mean for mean in means if mean.capture == capture]
        if here:
            tables.append(_table(comparison, here, capture))
    note = (
        "The best of a column is bold, the second best underlined; ± is the standard deviation over seeds. A click on "
        "a heading sorts."
    )
    shown = [*_failed(comparison), Section("Scores", tables, note), _pareto(comparison, pooled or means)]

    def sections(detail: Detail) -> list[Section]:
        pictures = pictured(runs, titles, captures, detail, DEFAULT)
        return [*shown, *pictures, histories(runs, titles), every_run(comparison.rows), _conditions(comparison)]

    return Page(
        "Comparison of methods",
        _lead(comparison),
        digest_of_runs(runs, comparison.rows),
        sections,
        links_to(folder, LINKED),
    )


def read_comparison(path: Path) -> Comparison:
    """Raises InputError where the file is damaged, or no run has been scored yet."""
    document = read_json_object(path, "a comparison")
    try:
        failures = tuple(Failure(**failure) for failure in document["failed"])
        titles = {str(entry): str(title) for entry, title in document["methods"].items()}
        rows = [{str(k): v for k, v in row.items()} for row in document["rows"]]
        missing = tuple(map(str, document.get("missing", ())))  # an older version did not write them
        comparison = Comparison(titles, dict(document["conditions"]), rows, failures, missing)
        known = all(row["variant"] in titles and isinstance(row["seed"], int) for row in rows)
        comparison.means(), comparison.pooled()
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{path}: is damaged ({error}); run `aa4d compare` again, which keeps its runs") from None
    if not known:
        raise InputError(f"{path}: is damaged (a row of no method); run `aa4d compare` again, which keeps its runs")
    if not rows:
        raise InputError(f"{path}: no run has been scored yet; run `aa4d compare` again")
    return comparison


def _lead(comparison: Comparison) -> str:
    c: dict[str, Any] = comparison.conditions
    methods = {str(row["variant"]) for row in comparison.rows}
    counts = ((methods, "method"), (comparison.captures, "capture"), (comparison.rows, "run"))
    return (
        f"{', '.join(counted(len(of), what) for of, what in counts)}; "
        f"{c.get('coarse_iterations')} + {c.get('fine_iterations')} iterations of preset {c.get('preset')}. Equal for "
        "all are frames and their split, camera poses, the points that they start from, the rasterizer and the scoring."
    )


def _table(comparison: Comparison, means: list[Mean], title: str) -> Table:
    """As compare.md has it; every cell sorts by its mean."""

    def mark(text: str, place: int) -> str:
        return f"{'12'[place]}{text}"  # a digit before the number, taken off below

    scores = [score for score in comparison.scores if any(score.key in mean.spreads for mean in means)]
    plain, placed = table_of(comparison, means), table_of(comparison, means, mark)
    rows: list[list[str | Cell | None]] = []
    for mean, texts, marks in zip(means, plain[1:], placed[1:], strict=True):
        row: list[str | Cell | None] = [texts[0]]
        for score, text, marked_text in zip(scores, texts[1:], marks[1:], strict=True):
            place = "" if text == marked_text else ("best", "second")["12".index(marked_text[0])]
            row.append(Cell(text, mean.spreads[score.key].mean, place) if text else None)
        rows.append(row)
    columns = [
        Column("method", is_number=False),
        *(Column(re.sub(" ([↑↓])$", "\u00a0\\1", s.heading), s.digits, s.good) for s in scores),
    ]
    return Table(columns, rows, title)


def _failed(comparison: Comparison) -> list[Section]:
    said = [
        f"{f.capture}, {comparison.titles.get(f.entry, f.entry)}, seed {f.seed}: {f.sentence}"
        for f in comparison.failures
    ]
    sections = [Section("Failed", [Text(line, "warning") for line in said])] if said else []
    if comparison.unfinished is not None:
        sections.insert(0, Section("", [Text(comparison.unfinished, "warning")]))
    return sections


def _pareto(comparison: Comparison, means: Sequence[Mean]) -> Section:
    """Quality against each cost; the gray line joins what nothing beats in both."""
    if len({mean.capture for mean in means}) > 1:  # of one capture, where no mean over all is to be had
        means = [mean for mean in means if mean.capture == means[0].capture]
    plots = [_panel(comparison, means, quality, cost) for quality in UP for cost in ACROSS]
    captures = comparison.pooled_over()
    where = captures[0] if len(captures) == 1 else means[0].capture
    note = f"Of {where}. Bars are standard deviations over seeds, the gray line joins what nothing beats in both"
    if any(mean.entry == TRACKED for mean in means):
        note += ", the star is what aa4d train does where nothing is said"
    return Section("Quality against cost", [plot for plot in plots if plot is not None], f"{note}.")


def _panel(comparison: Comparison, means: Sequence[Mean], quality: Score, cost: Score) -> Plot | None:
    there = [mean for mean in means if {quality.key, cost.key} <= mean.spreads.keys()]
    points = [(mean.spreads[cost.key].mean, mean.spreads[quality.key].mean) for mean in there]
    if not points:
        return None
    best = [points[n] for n in front(points, cost.good)]
    series = [Series("not beaten in both", best, line=True, dots=False, faint=True)]
    for mean, point in zip(there, points, strict=True):
        errors = (mean.spreads[cost.key].deviation, mean.spreads[quality.key].deviation)
        note = f"{point[1]:.2f} dB, {point[0]:.4g}"
        number = list(comparison.titles).index(mean.entry)
        title = comparison.titles[mean.entry]
        series.append(Series(title, [point], errors=[errors], notes=[note], star=mean.entry == TRACKED, color=number))
    label = f"{LABELS[cost.key]} ({'more' if cost.good > 0 else 'less'} is better)"
    return Plot(
        f"{quality.title} against {cost.title}", label, f"{quality.title}, dB", series, log_x=True, least_span=SPAN_DB
    )


def _conditions(comparison: Comparison) -> Section:
    rows = [[key.replace("_", " "), str(value)] for key, value in comparison.conditions.items()]
    columns = [Column("condition", is_number=False), Column("value", is_number=False)]
    return Section("Conditions", [Table(columns, rows, sorts=False)], folded=True)
