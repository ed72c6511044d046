"""Loss, PSNR and anchors over training, from the run's history.csv (docs/formats.md)."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

from aa4d.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMNS = ("step", "stage", "psnr_db", "anchors")  # those that are shown


@dataclass(frozen=True)
class Row:
    step: int
    stage: str
    psnr_db: float
    anchors: int


def read_history(path: Path) -> list[Row] | None:
    """None where the run has no history.

    Raises:
        InputError: it is no table, lacks a column or holds something other than numbers. An infinite PSNR is one: of
            views without any error, as in an all-black clip.
    """
    if not path.exists():
        return None
    try:
        table = csv.DictReader(io.StringIO(path.read_text(encoding="utf-8")))
        if missing := [c for c in COLUMNS if c not in (table.fieldnames or [])]:
            raise InputError(f"{path}: has no column {missing[0]!r}; delete it, or train again")
        rows = [Row(int(r["step"]), r["stage"], float(r["psnr_db"]), int(r["anchors"])) for r in table]
    except (ValueError, TypeError, OSError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read as a history ({error}); delete it, or train again") from None
    bad = [row for row in rows if math.isnan(row.psnr_db) or row.psnr_db == -math.inf]
    if bad:
        raise InputError(f"{path}: psnr_db of step {bad[0].step} is {bad[0].psnr_db}; delete it, or train again")
    return rows or None


def history_figure(rows: list[Row]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3), layout="constrained")
    panels = figure.subplots(1, 2)
    steps = [row.step for row in rows]
    psnr_db = [row.psnr_db if math.isfinite(row.psnr_db) else math.nan for row in rows]  # no error leaves a gap
    for axes, values, label in (
        (panels[0], [row.anchors for row in rows], "anchors"),
        (panels[1], psnr_db, "PSNR of training views, dB"),
    ):
        axes.plot(steps, values, lw=1)
        axes.set(xlabel="iteration", ylabel=label)
        axes.grid(alpha=0.3)
        for before, after in pairwise(rows):
            if before.stage != after.stage:
                axes.axvline(before.step, color="0.4", lw=0.8, ls="--")
                axes.annotate(f"{after.stage} stage", (before.step, 1.0), xycoords=("data", "axes fraction"),
                              xytext=(3, -10), textcoords="offset points", fontsize=8)  # fmt: skip
    return figure
