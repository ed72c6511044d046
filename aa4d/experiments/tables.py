"""Rows of trials become tables: every run, mean and spread over seeds, and a picture."""

from __future__ import annotations

import csv
import io
import math
import statistics
from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

from aa4d.experiments.against import plot_against
from aa4d.experiments.axis import Knob
from aa4d.experiments.kinds.evaluate import Row
from aa4d.experiments.variants import Experiment
from aa4d.files import whole_file, write_text
from aa4d.words import in_figure

ACTIVITY = "psnr_activity."
POOLED = "differences over all pairs of capture and seed, mean ± standard error"


@dataclass(frozen=True)
class Column:
    """A metric as a table shows it."""

    key: str
    title: str
    digits: int


def columns_of(rows: list[Row]) -> list[Column]:
    """Quality first, then cost; only what was measured."""
    measured = {key for row in rows for key in row}
    lpips = sorted(key for key in measured if key.startswith("lpips."))
    known = [
        Column("psnr", "PSNR", 2),
        Column("psnr_dynamic", "Dyn-PSNR", 2),
        Column("psnr_still", "Still-PSNR", 2),
        Column("ssim", "SSIM", 4),
        *(Column(key, f"LPIPS {key.removeprefix('lpips.')}", 4) for key in lpips),
        Column("psnr_swept", "swept ground", 2),
        Column("second_drone.psnr_seen", "second drone", 2),
        Column("second_drone.psnr_dynamic", "second drone, moving", 2),
        Column("motion_epe_px", "motion error px", 2),
        Column("travel_ratio", "travel", 2),
        Column("group_error_m", "group error m", 2),
        Column("training_seconds", "seconds", 0),
        Column("fps", "frames/s", 0),
        Column("neural_mib", "neural MiB", 2),
        Column("total_mib", "MiB", 1),
    ]
    return [column for column in known if column.key in measured]


def pooled_columns_of(rows: list[Row]) -> list[Column]:
    """Those of the table, training frames, and every activity class."""
    activity = dict.fromkeys(key for row in rows for key in row if key.startswith(ACTIVITY))
    more = [Column("psnr_training", "training PSNR", 2)] if any("psnr_training" in row for row in rows) else []
    more += [Column(key, f"PSNR {key.removeprefix(ACTIVITY)}", 2) for key in activity]
    return [*columns_of(rows), *more]


@dataclass(frozen=True)
class Spread:
    """Over seeds: mean and sample standard deviation (None for a single one)."""

    mean: float
    deviation: float | None
    count: int

    @staticmethod
    def of(values: list[float]) -> Spread:
        return Spread(statistics.fmean(values), statistics.stdev(values) if len(values) > 1 else None, len(values))

    @property
    def standard_error(self) -> float | None:
        """Of the mean."""
        return None if self.deviation is None else self.deviation / math.sqrt(self.count)

    def text(self, digits: int, *, signed: bool = False) -> str:
        """Mean ± standard deviation."""
        return _text(self.mean, self.deviation, digits, signed)

    def mean_text(self, digits: int) -> str:
        """Signed mean ± its standard error."""
        return _text(self.mean, self.standard_error, digits, signed=True)


def _text(mean: float, error: float | None, digits: int, signed: bool) -> str:
    text = f"{mean:{'+' if signed else ''}z.{digits}f}"  # "z": what is rounded to zero has no sign of its own
    return text if error is None else f"{text} ±{error:.{digits}f}"


@dataclass(frozen=True)
class Line:
    """A variant on a capture. `gain_db`: PSNR over the first variant's, seed by seed; None where no seed has both."""

    capture: str
    variant: str
    seeds: int
    spreads: dict[str, Spread]  # by the key of the column
    gain_db: Spread | None


def lines_of(experiment: Experiment, rows: list[Row]) -> list[Line]:
    """One for each capture and variant that has been run, in the experiment's order."""
    first = experiment.variants[0].label
    lines = []
    for capture in dict.fromkeys(str(row["capture"]) for row in rows):
        by_seed = {row["seed"]: row for row in rows if row["capture"] == capture and row["variant"] == first}
        for variant in experiment.variants:
            here = [row for row in rows if row["capture"] == capture and row["variant"] == variant.label]
            if not here:
                continue
            spreads = {
                column.key: Spread.of([float(row[column.key]) for row in here if column.key in row])
                for column in columns_of(here)
            }
            gains = [float(row["psnr"]) - float(by_seed[row["seed"]]["psnr"]) for row in here if row["seed"] in by_seed]
            lines.append(Line(capture, variant.label, len(here), spreads, Spread.of(gains) if gains else None))
    return lines


@dataclass(frozen=True)
class Difference:
    """A variant minus another one, over all pairs of capture and seed that have both."""

    variant: str
    over: str
    pairs: int
    spreads: dict[str, Spread]  # by the key of the column, over the pairs that have it


def differences_of(experiment: Experiment, rows: list[Row]) -> list[Difference]:
    """Every variant minus every earlier one, those from the first variant first."""
    by_pair = {
        variant.label: {(row["capture"], row["seed"]): row for row in rows if row["variant"] == variant.label}
        for variant in experiment.variants
    }
    found = []
    for over, variant in combinations(by_pair, 2):
        pairs = [(by_pair[variant][pair], by_pair[over][pair]) for pair in by_pair[variant] if pair in by_pair[over]]
        spreads = {}
        for key in (column.key for column in pooled_columns_of(rows)):
            values = [float(new[key]) - float(old[key]) for new, old in pairs if key in new and key in old]
            if values:
                spreads[key] = Spread.of(values)
        if pairs:
            found.append(Difference(variant, over, len(pairs), spreads))
    return found


def cells(line: Line, columns: list[Column]) -> list[str]:
    """A line as text: variant, seeds, the columns, the gain."""
    values = [line.spreads[c.key].text(c.digits) if c.key in line.spreads else "" for c in columns]
    return [line.variant, str(line.seeds), *values, "" if line.gain_db is None else line.gain_db.text(2, signed=True)]


def headings(columns: list[Column]) -> list[str]:
    return ["variant", "seeds", *(column.title for column in columns), "PSNR gain"]


def write_tables(experiment: Experiment, rows: list[Row], out: Path, knob: Knob | None = None) -> None:
    """Write, each file whole, what was measured.

    rows.csv: every run, every number. table.csv, table.md: mean ± standard deviation over seeds. pooled.csv, pooled.md:
    differences between variants over all pairs of capture and seed, mean ± standard error. plot.png: where rows
    have `at`, the position of a knob, scores against it.
    """
    columns, lines = columns_of(rows), lines_of(experiment, rows)
    keys = list(dict.fromkeys(key for row in rows for key in row))
    write_text(out / "rows.csv", as_csv([keys, *([str(row.get(key, "")) for key in keys] for row in rows)]))
    table = [["capture", *headings(columns)], *([line.capture, *cells(line, columns)] for line in lines)]
    write_text(out / "table.csv", as_csv(table))
    write_text(out / "table.md", f"{experiment.title}\n\n{as_markdown(table)}")
    pooled = _pooled_table(differences_of(experiment, rows), pooled_columns_of(rows))
    write_text(out / "pooled.csv", as_csv(pooled))
    write_text(out / "pooled.md", f"{experiment.title}: {POOLED}\n\n{as_markdown(pooled)}")
    if knob is None:
        _plot(experiment, rows, out / "plot.png")
    else:
        plot_against(knob, experiment.title, rows, out / "plot.png")


def _pooled_table(differences: list[Difference], columns: list[Column]) -> list[list[str]]:
    """Where only some pairs have a column, the cell says how many."""
    table = [["variant", "over", "pairs", *(column.title for column in columns)]]
    for difference in differences:
        line = [difference.variant, difference.over, str(difference.pairs)]
        for column in columns:
            spread = difference.spreads.get(column.key)
            some = (
                "" if spread is None or spread.count == difference.pairs else f" ({spread.count} of {difference.pairs})"
            )
            line.append("" if spread is None else spread.mean_text(column.digits) + some)
        table.append(line)
    return table


def as_markdown(table: list[list[str]]) -> str:
    lines = [table[0], ["---"] * len(table[0]), *table[1:]]
    return "".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in line)} |\n" for line in lines)


def as_csv(rows: list[list[str]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def _plot(experiment: Experiment, rows: list[Row], path: Path) -> None:
    """Every seed a dot, the mean a bar across: PSNR and, where there is truth, that of moving pixels."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    shown = [column for column in columns_of(rows) if column.key in ("psnr", "psnr_dynamic")]
    captures = list(dict.fromkeys(str(row["capture"]) for row in rows))
    labels = [variant.label for variant in experiment.variants]
    figure = Figure(figsize=(2.5 + 1.3 * len(labels), 3.2 * len(shown)), layout="constrained")
    FigureCanvasAgg(figure)
    place: Callable[[str], int] = labels.index
    for number, column in enumerate(shown):
        axes = figure.add_subplot(len(shown), 1, number + 1)
        for index, capture in enumerate(captures):
            here = [row for row in rows if row["capture"] == capture and column.key in row]
            color, shift = f"C{index}", 0.15 * (index - (len(captures) - 1) / 2)
            x = [place(str(row["variant"])) + shift for row in here]
            axes.scatter(
                x, [float(row[column.key]) for row in here], color=color, s=18, alpha=0.7, label=in_figure(capture)
            )
            for line in lines_of(experiment, here):
                at = place(line.variant) + shift
                axes.hlines(line.spreads[column.key].mean, at - 0.12, at + 0.12, color=color)
        axes.set_xticks(range(len(labels)), list(map(in_figure, labels)))
        axes.set_xlim(-0.5, len(labels) - 0.5)
        axes.set_ylabel(f"{column.title}, dB")
        axes.grid(axis="y", alpha=0.3)
        if number == 0:
            axes.set_title(in_figure(experiment.title), fontsize=10)
            axes.legend(fontsize=8)
    with whole_file(path) as temporary:
        figure.savefig(temporary, format="png", dpi=110)
