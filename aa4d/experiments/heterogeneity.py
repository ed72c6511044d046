"""What heterogeneity does to each variant: scores against a scene's indices, with intervals by bootstrap.

    python -m aa4d.experiments.heterogeneity out/study/tables/rows.csv --out out/study/heterogeneity

Scenes and seeds are samples of what one would like to say something about. The bootstrap draws scenes, and seeds within
each, with replacement: its 95 % intervals hold for other scenes and seeds of the same kind. Variants are compared seed
by seed with the first one, or with another.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from tyro.conf import Positional, arg

from aa4d.errors import InputError
from aa4d.experiments.outputs import rows_of
from aa4d.experiments.program import run_as_program
from aa4d.experiments.tables import as_csv, as_markdown
from aa4d.files import make_folder, whole_file, write_json, write_text
from aa4d.words import counted, in_figure

Array = NDArray[np.float64]
PREFIX = "heterogeneity."
INDICES = {"active_share": "share of the ground that is ever active", "changes_per_s": "changes per second and cell"}
# Keys of rows, what they are called, and how they are written.
SCORES = {
    "psnr": "PSNR, dB",
    "psnr_dynamic": "PSNR of moving pixels, dB",
    "psnr_activity.static": "PSNR of what never moves, dB",
    "psnr_activity.intermittent": "PSNR of what moves at times, dB",
    "psnr_activity.persistent": "PSNR of what moves always, dB",
    "psnr_swept": "PSNR of swept ground, dB",
    "psnr_still": "PSNR of still pixels, dB",
    "second_drone.psnr_seen": "PSNR from the second drone, dB",
    "second_drone.psnr_dynamic": "moving pixels from the second drone, dB",
    "motion_epe_px": "motion error, px",
    "activity_rank_correlation": "rank correlation of weights and activity",
    "training_processor_seconds": "seconds of the processor",
}
DRAWS = 2000
LEVEL = 0.95


@dataclass(frozen=True)
class Interval:
    """A figure and where 95 % of the bootstrap's lie."""

    value: float
    low: float
    high: float

    def text(self) -> str:
        return f"{self.value:+.2f} [{self.low:+.2f}, {self.high:+.2f}]"


@dataclass(frozen=True)
class Finding:
    """A variant against another, in one score."""

    variant: str
    score: str
    scenes: int
    seeds: int
    gain: Interval  # mean over scenes
    slopes: dict[str, Interval]  # of the gain, from the least to the greatest value of each index


@dataclass(frozen=True)
class Scores:
    """One score of one variant: [scenes, seeds], and the scenes' indices."""

    values: Array
    indices: dict[str, Array]  # [scenes] each


def bootstrap(
    values: Array, statistic: Callable[[Array, NDArray[np.int64]], float], generator: np.random.Generator
) -> Interval:
    """The statistic of means over seeds, and its interval.

    Args:
        values: [scenes, seeds].
        statistic: of means [scenes] and of which scenes they are of, [scenes]; NaN where a draw has none.
    """
    scenes, seeds = values.shape
    every = np.arange(scenes)
    drawn = []
    for _ in range(DRAWS):
        chosen = generator.integers(0, scenes, scenes)
        columns = generator.integers(0, seeds, (scenes, seeds))
        drawn.append(statistic(values[chosen[:, None], columns].mean(axis=1), chosen))
    rest = (1 - LEVEL) / 2
    low, high = np.nanquantile(drawn, [rest, 1 - rest])
    return Interval(statistic(values.mean(axis=1), every), float(low), float(high))


def slope(x: Array) -> Callable[[Array, NDArray[np.int64]], float]:
    """Least squares over scenes, times the span of the index `x` [scenes]: what the score changes over it."""
    span = float(np.ptp(x))

    def statistic(means: Array, chosen: NDArray[np.int64]) -> float:
        here = x[chosen] - x[chosen].mean()
        spread = float(here @ here)
        return float("nan") if spread < 1e-12 * span * span else float(here @ (means - means.mean())) / spread * span

    return statistic


def scores_of(rows: list[dict[str, Any]], variant: str, key: str) -> Scores | None:
    """Of the scenes that have it with every seed of the variant; None where there are fewer than three.

    Raises:
        InputError: a row lacks the indices.
    """
    mine = [row for row in rows if row["variant"] == variant and row.get(key) is not None]
    seeds = sorted({row["seed"] for row in mine})
    by_run = {(row["capture"], row["seed"]): row for row in mine}
    scenes = [s for s in dict.fromkeys(row["capture"] for row in rows) if all((s, seed) in by_run for seed in seeds)]
    if not mine or len(scenes) < 3:
        return None
    indices = {}
    for name in INDICES:
        found = [by_run[scene, seeds[0]].get(PREFIX + name) for scene in scenes]
        if None in found:
            scene = scenes[found.index(None)]
            raise InputError(
                f"{scene}: its rows lack {PREFIX}{name}; render it with the truth pass `activity` and score its runs "
                "again"
            )
        indices[name] = np.array(found, dtype=np.float64)
    values = np.array([[float(by_run[scene, seed][key]) for seed in seeds] for scene in scenes])
    return Scores(values, indices)


def findings(rows: list[dict[str, Any]], against: str | None = None) -> list[Finding]:
    """Every other variant against one, by default the first, in scores that both have for the same scenes and seeds.

    Raises:
        InputError: there is no variant `against`; a row lacks the indices.
    """
    variants = variants_of(rows)
    base = against or variants[0]
    if base not in variants:
        raise InputError(f"--against {base!r}: the rows have {', '.join(map(repr, variants))}")
    generator = np.random.default_rng(0)
    found = []
    for key in SCORES:
        first = scores_of(rows, base, key)
        for variant in variants:
            if variant == base:
                continue
            other = scores_of(rows, variant, key)
            if first is None or other is None or first.values.shape != other.values.shape:
                continue
            gain = other.values - first.values
            mean = bootstrap(gain, lambda means, _: float(means.mean()), generator)
            slopes = {name: bootstrap(gain, slope(x), generator) for name, x in other.indices.items() if np.ptp(x) > 0}
            found.append(Finding(variant, key, gain.shape[0], gain.shape[1], mean, slopes))
    return found


def variants_of(rows: list[dict[str, Any]]) -> list[str]:
    return list(dict.fromkeys(str(row["variant"]) for row in rows))


def report(
    rows: Annotated[Positional[Path], arg(help="rows.csv of an experiment.")],
    out: Annotated[Path, arg(help="Folder for the tables and the figures.")],
    against: Annotated[str | None, arg(help="Variant that the others are compared with; by default the first.")] = None,
) -> None:
    """Write heterogeneity.md, heterogeneity.json, a figure for each score, scenes.csv with their indices, and
    means.csv, gains.csv and slopes-*.csv with a row for each variant."""
    table = rows_of(rows)
    found = findings(table, against)
    if not found:
        raise InputError(f"{rows}: needs two variants with scores of three scenes or more, with the same seeds")
    make_folder(out)
    figures = []
    for key in dict.fromkeys(finding.score for finding in found):
        name = f"{key.replace('.', '-')}.png"
        plot(table, key, out / name)
        figures.append(f"![{SCORES[key]}]({name})\n")
    write_json(out / "heterogeneity.json", {"rows": [asdict(finding) for finding in found]})
    base = against or variants_of(table)[0]
    write_text(out / "heterogeneity.md", page(base, found) + "\n" + "\n".join(figures))
    write_text(out / "scenes.csv", as_csv(scenes(table)))
    write_text(out / "means.csv", as_csv(means(table)))
    write_text(out / "gains.csv", as_csv(wide(found, lambda finding: finding.gain)))
    for name in INDICES:
        write_text(out / f"slopes-{name}.csv", as_csv(wide(found, _slope_over(name))))
    print(out / "heterogeneity.md")


def scenes(rows: list[dict[str, Any]]) -> list[list[str]]:
    """A row for each scene: its indices, under a row of heads."""
    indices = {str(row["capture"]): [str(row.get(PREFIX + name, "")) for name in INDICES] for row in rows}
    return [["scene", *INDICES], *([scene, *values] for scene, values in indices.items())]


def means(rows: list[dict[str, Any]]) -> list[list[str]]:
    """A row for each variant: its scores in the mean over scenes and seeds, under a row of heads."""
    found = [["variant", *SCORES]]
    for variant in variants_of(rows):
        scores = [scores_of(rows, variant, key) for key in SCORES]
        found.append([variant, *("" if s is None else f"{s.values.mean():.2f}" for s in scores)])
    return found


def wide(found: list[Finding], pick: Callable[[Finding], Interval | None]) -> list[list[str]]:
    """A row for each variant: an interval of each score, under a row of heads."""
    text = {(f.variant, f.score): interval.text() for f in found if (interval := pick(f)) is not None}
    variants = dict.fromkeys(f.variant for f in found)
    return [["variant", *SCORES], *([v, *(text.get((v, key), "") for key in SCORES)] for v in variants)]


def _slope_over(index: str) -> Callable[[Finding], Interval | None]:
    return lambda finding: finding.slopes.get(index)


def page(base: str, found: list[Finding]) -> str:
    about = (
        f"{counted(found[0].scenes, 'scene')}, {counted(found[0].seeds, 'seed')}. Gains over "
        f"`{base}`, seed by seed, in the mean over scenes; a slope is what the gain changes from the "
        f"least to the greatest value of the index. In brackets: {LEVEL:.0%} intervals of {DRAWS:,} bootstrap draws "
        "over scenes, and seeds within them. A slope whose interval holds zero says nothing.\n"
    )
    lines = ["# Scores against heterogeneity\n", about]
    for key in dict.fromkeys(finding.score for finding in found):
        here = [finding for finding in found if finding.score == key]
        heads = ["variant", "gain", *(f"slope over the {INDICES[name]}" for name in here[0].slopes)]
        cells = [[f.variant, f.gain.text(), *(interval.text() for interval in f.slopes.values())] for f in here]
        lines += [f"## {SCORES[key]}\n", as_markdown([heads, *cells])]
    return "\n".join(lines)


def plot(rows: list[dict[str, Any]], key: str, path: Path) -> None:
    """A panel for each index: the mean of each scene with the standard deviation over seeds, a color for a variant."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    variants = variants_of(rows)
    figure = Figure(figsize=(10, 3.8), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, len(INDICES), sharey=True, squeeze=False)[0]
    for number, variant in enumerate(variants):
        scores = scores_of(rows, variant, key)
        if scores is None:
            continue
        means, spread = scores.values.mean(axis=1), scores.values.std(axis=1)
        for panel, (name, title) in zip(panels, INDICES.items(), strict=True):
            x = scores.indices[name]
            shift = (number - len(variants) / 2) * 0.008 * float(np.ptp(x))  # so that bars do not hide one another
            panel.errorbar(x + shift, means, yerr=spread, fmt="o", markersize=4, elinewidth=1, color=f"C{number}",
                           label=in_figure(variant))  # fmt: skip
            panel.set_xlabel(title)
            panel.grid(alpha=0.25)
    panels[0].set_ylabel(SCORES[key])
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 5), fontsize=9, frameon=False)
    with whole_file(path) as temporary:
        figure.savefig(temporary, format="png", dpi=120)


if __name__ == "__main__":
    run_as_program(report)
