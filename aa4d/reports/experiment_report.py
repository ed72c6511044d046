"""The report of an experiment: of an ablation, a sweep, or what an experiment file asked for."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from aa4d.errors import InputError
from aa4d.experiments.comparison_tables import COST, QUALITY
from aa4d.experiments.kinds.evaluate import Row
from aa4d.experiments.tables import POOLED, Spread, columns_of, differences_of, lines_of, pooled_columns_of
from aa4d.experiments.tables import Column as Metric
from aa4d.experiments.variants import ABLATIONS, SWEEPS, Experiment, Variant
from aa4d.files import read_json_object
from aa4d.reports.fitting import Page, links_to
from aa4d.reports.page import Cell, Code, Column, Part, Section, Table, Text, Value
from aa4d.reports.pictures import Detail
from aa4d.reports.plot import Plot, Series
from aa4d.reports.results import digest_of_runs, every_run, histories, pictured, rows_from, runs_of
from aa4d.reports.run_report import flattened
from aa4d.reports.scored import Captures
from aa4d.words import counted

INDEX = "experiment.json"
FILE = "experiment.toml"  # a copy of the experiment file
GOOD = {score.key: score.good for score in (*QUALITY, *COST)} | {"training_seconds": -1, "group_error_m": -1}
PLOTTED = ("psnr", "psnr_dynamic", "psnr_swept", "second_drone.psnr_seen", "second_drone.psnr_dynamic")
LINKED = ("table.md", "pooled.md", "rows.csv", "plot.png", FILE)


def experiment_page(folder: Path, captures: Captures) -> Page:
    """Raises InputError where nothing has been scored yet, or a file is damaged."""
    index = read_json_object(folder / INDEX, "the index of an experiment")
    tables = folder / "tables" if (folder / FILE).exists() else folder
    if not (tables / "rows.csv").exists():
        raise InputError(f"{folder}: no run has been scored yet; run the command that makes it again")
    rows = rows_from(tables / "rows.csv")
    experiment, settings = _experiment(folder, index, rows)
    runs, titles = runs_of(folder, rows), {variant.label: variant.label for variant in experiment.variants}
    counts = (
        (len(rows), "run"),
        (len(titles), "variant"),
        *((len({r[k] for r in rows}), k) for k in ("capture", "seed")),
    )
    lead = f"{', '.join(counted(count, what) for count, what in counts)}. ± is the standard deviation over seeds."
    axis = _file(folder).get("axis")
    plots = _over_knob(axis if isinstance(axis, dict) else {}, rows) or _plots(experiment, rows)
    tabulated = [*_failed(tables), _means(experiment, rows), _differences(experiment, rows), plots]

    def sections(detail: Detail) -> list[Section]:
        shown = pictured(runs, titles, captures, detail, experiment.variants[0].label)
        return [*tabulated, *shown, histories(runs, titles), every_run(rows), settings]

    links = [f"{'tables/' if tables != folder else ''}{name}" if name != FILE else name for name in LINKED]
    return Page(experiment.title, lead, digest_of_runs(runs, rows), sections, links_to(folder, links))


def _experiment(folder: Path, index: dict[str, Any], rows: Sequence[Row]) -> tuple[Experiment, Section]:
    """What was compared, with variants in the order of the tables; and the settings that all had."""
    labels = list(dict.fromkeys(str(row["variant"]) for row in rows))
    name, settings = str(index.get("experiment", "")), Section("Settings", [], folded=True)
    if (folder / FILE).is_file():
        text = (folder / FILE).read_text(encoding="utf-8", errors="replace")
        settings = Section("Settings", [Code(text, "the experiment file")], folded=True)
        title = str(_file(folder).get("title", name or folder.resolve().name))
        return Experiment(name, title, tuple(map(Variant, labels))), settings
    known = (ABLATIONS | SWEEPS).get(name)
    if known is not None:  # in its own order, whichever run ended first
        order = [variant.label for variant in known.variants]
        labels.sort(key=lambda label: order.index(label) if label in order else len(order))
    training = index.get("training")
    if isinstance(training, dict):
        table = Table([Column("setting", is_number=False), Column("value", is_number=False)], flattened(training))
        settings = Section(
            "Settings", [Text("Of all variants, but for what each changes.", "note"), table], folded=True
        )
    title = known.title if known is not None else name or folder.resolve().name
    return Experiment(name, title, tuple(map(Variant, labels))), settings


def _file(folder: Path) -> dict[str, Any]:
    """The experiment file's content; empty where there is none that can be read."""
    try:
        return tomllib.loads((folder / FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}


def _failed(tables: Path) -> list[Section]:
    path = tables / "failed.md"
    if not path.is_file():
        return []
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    return [Section("Failed", [Text(line.removeprefix("- "), "warning") for line in lines])]


def _means(experiment: Experiment, rows: list[Row]) -> Section:
    metrics, parts = columns_of(rows), []
    lines = lines_of(experiment, rows)
    for capture in dict.fromkeys(line.capture for line in lines):
        here = [line for line in lines if line.capture == capture]
        table = [
            [
                line.variant,
                line.seeds,
                *(
                    _spread(line.spreads[m.key].mean, line.spreads[m.key].text(m.digits))
                    if m.key in line.spreads
                    else None
                    for m in metrics
                ),
                None if line.gain_db is None else _spread(line.gain_db.mean, line.gain_db.text(2, signed=True)),
            ]
            for line in here
        ]
        columns = [Column("variant", is_number=False), Column("seeds", 0), *map(column_of, metrics)]
        parts.append(
            Table([*columns, Column("PSNR gain", 2, 1, f"over {experiment.variants[0].label}")], table, capture)
        )
    return Section("Scores", parts, "A click on a heading sorts.")


def column_of(metric: Metric) -> Column:
    return Column(metric.title, metric.digits, GOOD.get(metric.key, 1 if metric.key.startswith("psnr") else 0))


def _spread(mean: float, text: str) -> Cell:
    return Cell(text, mean)


def _differences(experiment: Experiment, rows: list[Row]) -> Section:
    metrics = pooled_columns_of(rows)
    found = differences_of(experiment, rows)
    table: list[list[Value | Cell]] = []
    for difference in found:
        line: list[Value | Cell] = [difference.variant, difference.over, difference.pairs]
        for metric in metrics:
            spread = difference.spreads.get(metric.key)
            line.append(None if spread is None else _spread(spread.mean, spread.mean_text(metric.digits)))
        table.append(line)
    names = [Column("variant", is_number=False), Column("over", is_number=False), Column("pairs", 0)]
    parts: list[Part] = [Table([*names, *map(column_of, metrics)], table)] if table else []
    return Section("Differences", parts, f"{POOLED[0].upper()}{POOLED[1:]}.")


def _over_knob(axis: dict[str, Any], rows: list[Row]) -> Section | None:
    """Scores against the position of a knob, where the experiment turns one: means over captures and seeds."""
    turned = [row for row in rows if "at" in row]
    if not turned:
        return None
    plots = []
    for key, title in _titles(turned).items():
        series = []
        for variant in dict.fromkeys(str(row["variant"]) for row in turned):
            here = [row for row in turned if row["variant"] == variant and key in row]
            at = sorted({float(row["at"]) for row in here})
            spreads = [Spread.of([float(row[key]) for row in here if float(row["at"]) == x]) for x in at]
            points = [(x, spread.mean) for x, spread in zip(at, spreads, strict=True)]
            series.append(Series(variant, points, line=True, errors=[(None, s.deviation) for s in spreads]))
        label = str(axis.get("label", "position of the knob"))
        plots.append(Plot(title, label, f"{title}, dB", series, log_x=axis.get("log") is True))
    return Section("Scores against the knob", plots, "Means over scenes and seeds; bars are standard deviations.")


def _titles(rows: list[Row]) -> dict[str, str]:
    """Of the scores that are plotted, those that some row has."""
    titles = {metric.key: metric.title for metric in columns_of(rows)}
    return {key: titles[key] for key in PLOTTED if key in titles}


def _plots(experiment: Experiment, rows: list[Row]) -> Section:
    """Every seed a dot, the captures beside each other."""
    labels = [variant.label for variant in experiment.variants]
    captures = list(dict.fromkeys(str(row["capture"]) for row in rows))
    plots = []
    for key, title in _titles(rows).items():
        series = []
        for number, capture in enumerate(captures):
            shift = 0.5 * (number - (len(captures) - 1) / 2) / max(len(captures), 1)
            here = [row for row in rows if row["capture"] == capture and key in row]
            points = [(labels.index(str(row["variant"])) + shift, float(row[key])) for row in here]
            notes = [f"{row['variant']}, seed {row['seed']}: {float(row[key]):.2f} dB" for row in here]
            series.append(Series(capture, points, notes=notes))
        plots.append(Plot(title, "", f"{title}, dB", series, names=labels))
    return Section("Scores of every run", plots, "A dot is a run.")
