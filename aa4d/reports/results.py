"""The runs of an experiment or a comparison, found by the rows of its tables."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from aa4d.errors import InputError
from aa4d.experiments.kinds.evaluate import Row
from aa4d.experiments.kinds.trial import TEXTS
from aa4d.experiments.outputs import rows_of
from aa4d.files import read_json_object
from aa4d.graph.store import SHORT
from aa4d.identity import digest_of
from aa4d.reports.frames import Drawn, frame_sections
from aa4d.reports.page import Column, Section, Table
from aa4d.reports.pictures import Detail
from aa4d.reports.run_report import history_plots
from aa4d.reports.scored import METRICS, Captures, ScoredRun, scored_run
from aa4d.words import counted

NAMED = ("capture", "variant")
MOST_VARIANTS = 12  # in a loop, a slider and a row of cut-outs


def rows_from(path: Path) -> list[Row]:
    """Rows of rows.csv, as they were before they were written.

    Raises:
        InputError: it holds something else.
    """
    rows = []
    for number, row in enumerate(rows_of(path), 2):
        read: dict[str, Any] = {key: value for key, value in row.items() if value is not None}
        named = {key: str(read[key]) for key in NAMED if key in read}
        if (
            len(named) < len(NAMED)
            or not isinstance(read.get("seed"), int)
            or not isinstance(read.get("psnr"), float | int)
        ):
            raise InputError(
                f"{path}: line {number} has no capture, variant, seed and psnr; run the command that made it again"
            )
        wrong = [key for key, value in read.items() if key not in TEXTS and not isinstance(value, int | float)]
        if wrong:
            raise InputError(f"{path}: line {number}: {wrong[0]} is no number; run the command that made it again")
        rows.append(read | named)
    return rows


def runs_of(out: Path, rows: Sequence[Row]) -> dict[tuple[str, str, int], ScoredRun]:
    """The runs of rows by capture, variant and seed, in the folders that are named after them or where a graph keeps
    them; those that are gone are left out.

    Raises:
        InputError: the scores of one are damaged.
    """
    kept = _kept(out)
    found = {}
    for row in rows:
        capture, variant, seed = key = (str(row["capture"]), str(row["variant"]), int(row["seed"]))
        label = variant.replace(" ", "-")
        folder = out / capture / label / f"seed{seed}"
        if all(Path(part).name == part for part in (capture, label)) and (folder / METRICS).is_file():
            found[key] = scored_run(folder)
        elif (place := kept.get((f"{capture}, {variant}, seed {seed}", float(row["psnr"])))) is not None:
            found[key] = scored_run(*place)
    return found


def _kept(out: Path) -> dict[tuple[str, float], tuple[Path, Path]]:
    """Where a graph keeps evaluations and their trainings, by the evaluation's name and PSNR."""
    trainings = {path.name.rpartition("-")[2]: path for path in (out / "train").glob("*-*") if path.is_dir()}
    found = {}
    for path in sorted((out / "evaluate").glob("*.json")):
        try:
            record = read_json_object(path, "the record of a task")
        except InputError:
            continue
        result, needs, folder = record.get("result"), record.get("made_from"), path.with_suffix("")
        psnr = result.get("psnr") if isinstance(result, dict) else None
        if isinstance(psnr, int | float) and (folder / METRICS).is_file():
            digests = needs if isinstance(needs, dict) else {}
            trained = next((trainings[d[:SHORT]] for d in digests if d[:SHORT] in trainings), folder)
            found[str(record.get("name")), float(psnr)] = (folder, trained)
    return found


def digest_of_runs(runs: dict[tuple[str, str, int], ScoredRun], rows: Sequence[Row]) -> dict[str, str]:
    """What a page on them is made from."""
    return {"rows": digest_of(list(rows)), "evaluations": digest_of(sorted(run.digest for run in runs.values()))}


def pictured(
    runs: dict[tuple[str, str, int], ScoredRun],
    titles: dict[str, str],
    captures: Captures,
    detail: Detail,
    against: str,
) -> list[Section]:
    """For each capture its held-out frames by every variant, of the first seed, the last one over `against`."""
    sections = []
    lacking = [label for (_, label, _), run in runs.items() if run.missing()]
    if lacking:
        captures.tell(
            f"{counted(len(lacking), 'run')} without pictures of held-out frames, first one of {titles[lacking[0]]}."
        )
    for name in dict.fromkeys(key[0] for key in runs):
        seed = min(key[2] for key in runs if key[0] == name)
        drawn = [Drawn(titles[label], runs[name, label, seed]) for label in titles if (name, label, seed) in runs]
        drawn = drawn[:MOST_VARIANTS]
        capture = captures.of(drawn[0].run)
        sections += frame_sections(f"{name}: held-out frames, seed {seed}", capture, drawn, detail, titles.get(against))
    return sections


def histories(runs: dict[tuple[str, str, int], ScoredRun], titles: dict[str, str]) -> Section:
    """Curves of training on each capture, of the first seed."""
    plots = []
    for name in dict.fromkeys(key[0] for key in runs):
        seed = min(key[2] for key in runs if key[0] == name)
        curves = [(titles[v], runs[name, v, seed].history()) for v in titles if (name, v, seed) in runs]
        there = [(title, history) for title, history in curves if history is not None]
        if there:
            plots += history_plots(there, f" on {name}")
    return Section(
        "Over training", plots, note="The first seed; PSNR is that of training views, 20 iterations a point."
    )


def every_run(rows: Sequence[Row]) -> Section:
    """All numbers of all rows."""
    keys = list(dict.fromkeys(key for row in rows for key in row if key not in ("run", "version")))
    columns = [Column(key, is_number=key not in NAMED) for key in keys]
    table = Table(columns, [[row.get(key) for key in keys] for row in rows])
    return Section("Every number of every run", [table], folded=True)
