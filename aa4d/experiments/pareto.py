"""Quality against what it costs: minutes of training, frames a second, megabytes."""

from __future__ import annotations

from pathlib import Path

from aa4d.experiments.comparison import TRACKED
from aa4d.experiments.comparison_tables import COST, QUALITY, Comparison, Mean, Score
from aa4d.files import whole_file
from aa4d.words import in_figure

UP = tuple(score for score in QUALITY if score.key in ("psnr", "psnr_dynamic"))
ACROSS = tuple(score for key in ("processor_minutes", "fps", "total_mib") for score in COST if score.key == key)
LABELS = {
    "processor_minutes": "training, minutes of the processor",
    "fps": "frames a second",
    "total_mib": "model file, MiB",
}
MARKERS = "oDv^<>sXhd"
SPAN_DB = 1.0


def front(points: list[tuple[float, float]], good: int) -> list[int]:
    """Indices of the points that none beats in both, from the cheapest on.

    Args:
        points: cost and quality; more quality is better.
        good: which end of the cost is good, 1 the higher, -1 the lower.
    """
    order = sorted(range(len(points)), key=lambda n: (-good * points[n][0], -points[n][1]))
    best, found = float("-inf"), []
    for n in order:
        if points[n][1] > best:
            best = points[n][1]
            found.append(n)
    return found


def plot_pareto(comparison: Comparison, path: Path) -> None:
    """A row for each kind of quality, a column for each cost; the line joins what nothing beats in both.

    Over all captures where there are several; bars are standard deviations over seeds. What `aa4d train` does where
    nothing is said is a star.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    means, captures = comparison.pooled(), comparison.pooled_over()
    rows = [score for score in UP if any(score.key in mean.spreads for mean in means)]
    across = [cost for cost in ACROSS if any(cost.key in mean.spreads for mean in means)]
    if not rows or not across:
        return
    figure = Figure(figsize=(11, 3.1 * len(rows) + 0.9), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(rows), len(across), squeeze=False, sharex="col", sharey="row")
    for row, quality in enumerate(rows):
        for column, cost in enumerate(across):
            _panel(axes[row, column], comparison, means, quality, cost)
            if row == len(rows) - 1:
                axes[row, column].set_xlabel(f"{LABELS[cost.key]}  ({'more' if cost.good > 0 else 'less'} is better)")
        axes[row, 0].set_ylabel(f"{quality.title}, dB")
        _keep_apart(axes[row, 0])
    where = captures[0] if len(captures) == 1 else f"mean over {', '.join(captures)}"
    figure.suptitle(f"Quality against cost: {in_figure(where)}", fontsize=11, x=0.01, ha="left")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 5), fontsize=9, frameon=False)
    with whole_file(path) as temporary:
        figure.savefig(temporary, format="png", dpi=120)


def _keep_apart(axes: object) -> None:
    """Show at least `SPAN_DB`: what differs by less than runs do is not to look far apart."""
    from matplotlib.axes import Axes

    assert isinstance(axes, Axes)
    low, high = axes.get_ylim()
    more = max(SPAN_DB - (high - low), 0.0) / 2
    axes.set_ylim(low - more, high + more)


def _panel(axes: object, comparison: Comparison, means: list[Mean], quality: Score, cost: Score) -> None:
    from matplotlib.axes import Axes
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    assert isinstance(axes, Axes)
    there = [mean for mean in means if {quality.key, cost.key} <= mean.spreads.keys()]
    points = [(mean.spreads[cost.key].mean, mean.spreads[quality.key].mean) for mean in there]
    on_front = [points[n] for n in front(points, cost.good)]
    axes.plot(*zip(*on_front, strict=True), color="0.75", linewidth=1.5, zorder=1)
    for mean, (x, y) in zip(there, points, strict=True):
        number = list(comparison.titles).index(mean.entry)
        is_default = mean.entry == TRACKED
        axes.errorbar(
            x,
            y,
            xerr=mean.spreads[cost.key].deviation,
            yerr=mean.spreads[quality.key].deviation,
            fmt="*" if is_default else MARKERS[number % len(MARKERS)],
            markersize=15 if is_default else 8,
            markeredgecolor="white",
            color="black" if is_default else f"C{number}",
            elinewidth=1,
            label=comparison.titles[mean.entry] + (" (default)" if is_default else ""),
            zorder=3 if is_default else 2,
        )
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.margins(x=0.12)
    axes.grid(alpha=0.25, which="both")
