"""Rows of a comparison become the paper's table: a method a row, mean and deviation over seeds."""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from aa4d.experiments.kinds.evaluate import Row
from aa4d.experiments.tables import Spread, as_csv, as_markdown
from aa4d.experiments.trials import Outcome, Trial
from aa4d.files import write_json, write_text
from aa4d.words import counted

POOLED = "all captures"
PLACES = ("**{}**", "<u>{}</u>")  # the best and the second best of a column, as in the paper


@dataclass(frozen=True)
class Score:
    """A column of the comparison."""

    key: str  # of the rows
    title: str
    digits: int
    good: int  # which end of it: 1 the higher, -1 the lower, 0 neither

    @property
    def heading(self) -> str:
        return f"{self.title}{ {1: ' ↑', -1: ' ↓', 0: ''}[self.good] }"


QUALITY = (
    Score("psnr", "PSNR", 2, 1),
    Score("ssim", "SSIM", 4, 1),
    Score("lpips.alex", "LPIPS (alex)", 4, -1),
    Score("lpips.squeeze", "LPIPS (squeeze)", 4, -1),
    Score("lpips.vgg", "LPIPS (vgg)", 4, -1),
    Score("psnr_dynamic", "PSNR, moving", 2, 1),
    Score("psnr_still", "PSNR, still", 2, 1),
    Score("psnr_swept", "PSNR, swept ground", 2, 1),
    Score("second_drone.psnr_seen", "PSNR, second drone", 2, 1),
    Score("second_drone.psnr_dynamic", "second drone, moving", 2, 1),
    Score("motion_epe_px", "motion error, px", 2, -1),
    Score("travel_ratio", "travel (1 is right)", 2, 0),
)
COST = (
    Score("fps", "FPS", 1, 1),
    Score("fps_cached", "FPS from its cache", 1, 1),
    Score("minutes", "minutes", 1, -1),
    Score("processor_minutes", "processor minutes", 1, -1),
    Score("neural_mib", "neural MiB", 2, -1),
    Score("total_mib", "MiB", 1, -1),
    Score("anchors", "units", 0, 0),
    Score("gaussians", "Gaussians", 0, 0),
)


@dataclass(frozen=True)
class Mean:
    """A method on a capture, or on all of them."""

    capture: str
    entry: str
    seeds: int
    spreads: dict[str, Spread]  # by the key of the score


@dataclass(frozen=True)
class Failure:
    """A run that came to nothing."""

    capture: str
    entry: str
    seed: int
    sentence: str


@dataclass(frozen=True)
class Comparison:
    """What a comparison has found so far."""

    titles: dict[str, str]  # of the entries, in order
    conditions: dict[str, Any]  # what was equal, and how it was measured
    rows: list[Row]  # "minutes" and "processor_minutes" among their keys
    failures: tuple[Failure, ...] = ()
    missing: tuple[str, ...] = ()  # names of runs that are still to be made

    @staticmethod
    def of(outcome: Outcome, trials: list[Trial], titles: dict[str, str], conditions: dict[str, Any]) -> Comparison:
        rows = [row | _minutes(row) for row in outcome.rows]
        failures = (
            Failure(trial.capture.name, trial.label, trial.seed, outcome.failures[trial.name])
            for trial in trials
            if trial.name in outcome.failures
        )
        done = {(row["capture"], row["variant"], row["seed"]) for row in rows}
        missing = (
            trial.name
            for trial in trials
            if trial.name not in outcome.failures and (trial.capture.name, trial.label, trial.seed) not in done
        )
        return Comparison(titles, conditions, rows, tuple(failures), tuple(missing))

    @property
    def unfinished(self) -> str | None:
        """A sentence that names the runs that are missing; None where all are there or failed."""
        if not self.missing:
            return None
        runs = len(self.rows) + len(self.failures) + len(self.missing)
        return f"Unfinished: {len(self.missing)} of {counted(runs, 'run')} missing: {'; '.join(self.missing)}."

    @property
    def captures(self) -> list[str]:
        """Those with a run, in the order of the trials."""
        return list(dict.fromkeys([*(str(row["capture"]) for row in self.rows), *(f.capture for f in self.failures)]))

    @property
    def scores(self) -> list[Score]:
        """Those that some run has."""
        return [score for score in (*QUALITY, *COST) if any(score.key in row for row in self.rows)]

    def means(self) -> list[Mean]:
        """One for each capture and entry that has been run."""
        found = []
        for capture in self.captures:
            for entry in self.titles:
                here = [row for row in self.rows if (row["capture"], row["variant"]) == (capture, entry)]
                values = {s.key: [float(row[s.key]) for row in here if s.key in row] for s in self.scores}
                if here:
                    spreads = {key: Spread.of(given) for key, given in values.items() if given}
                    found.append(Mean(capture, entry, len(here), spreads))
        return found

    def pooled(self) -> list[Mean]:
        """Every entry over the captures: for each seed the mean over them, then mean and deviation over the seeds.

        Only over captures that every entry has with every seed, and without entries of which a run failed, so that all
        means are over the same runs; a score is pooled over the captures that have it.
        """
        by_run = {(row["capture"], row["seed"], row["variant"]): row for row in self.rows}
        seeds = sorted({int(row["seed"]) for row in self.rows})
        found = []
        for entry in self._pooled_entries():
            spreads = {}
            for score in self.scores:
                captures = self.pooled_over(score.key)
                if captures:
                    of_seed = [
                        statistics.fmean(float(by_run[capture, seed, entry][score.key]) for capture in captures)
                        for seed in seeds
                    ]
                    spreads[score.key] = Spread.of(of_seed)
            if spreads:
                found.append(Mean(POOLED, entry, len(seeds), spreads))
        return found

    def pooled_over(self, key: str = "psnr") -> list[str]:
        """The captures over which a score is pooled."""
        entries, seeds = self._pooled_entries(), {int(row["seed"]) for row in self.rows}
        there = {(row["capture"], row["seed"], row["variant"]) for row in self.rows if key in row}
        return [c for c in self.captures if entries and all((c, s, e) in there for s in seeds for e in entries)]

    def _pooled_entries(self) -> list[str]:
        failed = {failure.entry for failure in self.failures}
        return [e for e in self.titles if e not in failed and any(row["variant"] == e for row in self.rows)]


def _minutes(row: Row) -> Row:
    """Of training, by the clock and of the processor; a run of an older version has the first alone."""
    of = {"minutes": "training_seconds", "processor_minutes": "training_processor_seconds"}
    return {minutes: float(row[seconds]) / 60 for minutes, seconds in of.items() if seconds in row}


Mark = Callable[[str, int], str]


def table_of(comparison: Comparison, means: list[Mean], mark: Mark | None = None) -> list[list[str]]:
    """Headings, then a line for each entry of `means`; a score that an entry lacks is left blank.

    Args:
        mark: writes a cell that is best (0) or second best (1) of its column; None: as the others.
    """
    scores = [score for score in comparison.scores if any(score.key in mean.spreads for mean in means)]
    lines = [["method", *(score.heading for score in scores)]]
    columns = [_column(score, means, mark) for score in scores]
    for number, mean in enumerate(means):
        lines.append([comparison.titles[mean.entry], *(column[number] for column in columns)])
    return lines


def _column(score: Score, means: list[Mean], mark: Mark | None) -> list[str]:
    spreads = [mean.spreads.get(score.key) for mean in means]
    texts = ["" if spread is None else spread.text(score.digits) for spread in spreads]
    if mark is None or not score.good:
        return texts
    # What reads the same shares a place.
    shown = {round(spread.mean, score.digits) for spread in spreads if spread is not None}
    best = sorted(shown, key=lambda value: -score.good * value)[: len(PLACES)] if len(shown) > 1 else []
    for number, spread in enumerate(spreads):
        if spread is not None and (value := round(spread.mean, score.digits)) in best:
            texts[number] = mark(texts[number], best.index(value))
    return texts


def write_comparison(comparison: Comparison, out: Path, pictures: list[str]) -> None:
    """Write, each file whole: rows.csv (every run, every number), table.csv (means and deviations), compare.json (all
    of it), and compare.md, the page to read, which shows `pictures` (names in `out`)."""
    rows, means, pooled = comparison.rows, comparison.means(), comparison.pooled()
    keys = list(dict.fromkeys(key for row in rows for key in row))
    write_text(out / "rows.csv", as_csv([keys, *([str(row.get(key, "")) for key in keys] for row in rows)]))
    flat = [_flat(mean, comparison) for mean in (*means, *pooled)]
    keys = list(dict.fromkeys(key for line in flat for key in line))
    write_text(out / "table.csv", as_csv([keys, *([str(line.get(key, "")) for key in keys] for line in flat)]))
    document = {
        "conditions": comparison.conditions,
        "methods": comparison.titles,
        "rows": rows,
        "means": [asdict(mean) for mean in means],
        "pooled": [asdict(mean) for mean in pooled],
        "failed": [asdict(failure) for failure in comparison.failures],
        "missing": comparison.missing,
    }
    write_json(out / "compare.json", document)
    write_text(out / "compare.md", _page(comparison, means, pooled, pictures))


def _flat(mean: Mean, comparison: Comparison) -> dict[str, str | float]:
    """A line of table.csv; a deviation is there from two seeds on."""
    line: dict[str, str | float] = {
        "capture": mean.capture,
        "method": mean.entry,
        "title": comparison.titles[mean.entry],
        "seeds": mean.seeds,
    }
    for key, spread in mean.spreads.items():
        line[key] = spread.mean
        if spread.deviation is not None:
            line[f"{key}_deviation"] = spread.deviation
    return line


def _page(comparison: Comparison, means: list[Mean], pooled: list[Mean], pictures: list[str]) -> str:
    c = comparison.conditions
    seeds = f"seed {c['seeds'][0]}" if len(c["seeds"]) == 1 else counted(len(c["seeds"]), "seed")
    equal = (
        f"{c['coarse_iterations']:,} + {c['fine_iterations']:,} iterations of preset `{c['preset']}`, {seeds}. Equal "
        "for all methods: frames and their split, camera poses, the point cloud that they start from, the number of "
        "iterations, the rasterizer, the scoring. What else a method's preset says (views a step, spacing of its first "
        "units, bounds on them) is its own: `settings.toml` in each run. ± is the standard deviation over seeds; the "
        "best value of a column is bold, the second best underlined. What a capture has no truth for is blank.\n"
    )
    threads, jobs, processors = (counted(c[f"{what}s"], what) for what in ("thread", "job", "processor"))
    cost = (
        f"FPS is of the complete pipeline (choose, deform, decode, rasterize), {threads}, one run "
        f"after the other once all were trained; minutes are of training, {jobs} at a time on "
        f"{processors}, with whatever else the machine did; processor minutes are the run's alone. "
        "Neural MiB are networks and planes, MiB the model file. Units are anchors, or free Gaussians; "
        "Gaussians are those drawn.\n"
    )
    parts = ["# Comparison of methods\n", f"`{c['command']}`\n", equal, cost]
    if comparison.unfinished is not None:
        parts.insert(1, f"**{comparison.unfinished}** The same command goes on.\n")
    if len(comparison.pooled_over()) > 1:
        means_of = "Mean over the captures, for each score over those that have it.\n"
        parts += [f"## {POOLED[0].upper()}{POOLED[1:]}\n", means_of, as_markdown(table_of(comparison, pooled, _placed))]
    for capture in comparison.captures:
        here = [mean for mean in means if mean.capture == capture]
        lines = table_of(comparison, here, _placed)
        lines += failed_lines(comparison, capture, len(lines[0]))
        parts += [f"## {capture}\n", as_markdown(lines)]
    if comparison.failures:
        titles = comparison.titles
        failed = [f"- {f.capture}, {titles[f.entry]}, seed {f.seed}: {f.sentence}\n" for f in comparison.failures]
        parts += ["## Failed\n", "".join(failed)]
    parts += [f"![{Path(picture).stem}]({picture})\n" for picture in pictures]
    return "\n".join(parts)


def failed_lines(comparison: Comparison, capture: str, width: int) -> list[list[str]]:
    """Of the table of a capture: a line for each entry with runs that failed."""
    failed: dict[str, list[str]] = {}
    for failure in comparison.failures:
        if failure.capture == capture:
            failed.setdefault(failure.entry, []).append(str(failure.seed))
    return [
        [f"{comparison.titles[entry]}: failed (seed {', '.join(seeds)})", *[""] * (width - 1)]
        for entry, seeds in failed.items()
    ]


def _placed(text: str, place: int) -> str:
    return PLACES[place].format(text)
