"""Results of tasks become rows of the report's table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from aa4d.cost.panel import Measurement, Panel, Point
from aa4d.experiments.pareto import front

Row = dict[str, Any]
BETTER = {1: "higher", -1: "lower"}


def rows_of(name: str, panel: Panel, found: Sequence[Point]) -> list[Row]:
    """A row for each point.

    `on_front` says that no other point is both at most as dear, by what the panel's plot has across, and at least as
    good; it is None where there is no quality to compare.
    """
    beaten_by_none = set()
    if panel.quality is not None:
        known = [(n, point.quality) for n, point in enumerate(found) if point.quality is not None]
        pairs = [(cost_of(panel, found[n].processor_s, found[n].more), panel.quality.better * q) for n, q in known]
        beaten_by_none = {known[n][0] for n in front(pairs, good=-1)}
    return [
        {
            "panel": name,
            "title": panel.title,
            "label": label_of(point),
            "series": point.series,
            "point": point.label,
            "default": point.is_default,
            "per": panel.per,
            "processor_s": point.processor_s,
            "wall_s": point.wall_s,
            "cost": span(point.processor_s),
            "measure": None if panel.quality is None else panel.quality.label,
            "better": None if panel.quality is None else BETTER[panel.quality.better],
            "quality": point.quality,
            "on_front": None if point.quality is None else n in beaten_by_none,
            "more": point.more,
        }
        for n, point in enumerate(found)
    ]


def label_of(point: Point) -> str:
    series = f"{point.series}, " if point.series else ""
    return f"{series}{point.label}{' (default)' if point.is_default else ''}"


def span(seconds: float) -> str:
    """A time with its unit, to three digits."""
    units = (("h", 3600.0), ("min", 60.0), ("s", 1.0))
    unit, size = next(((unit, size) for unit, size in units if seconds >= size), ("ms", 1e-3))
    return f"{seconds / size:.3g} {unit}"


def cost_of(panel: Panel, processor_s: float, more: Mapping[str, Any]) -> float:
    """Where a point lies on the panel's horizontal axis."""
    return processor_s if panel.across is None else float(more[panel.across])


def points_of(measurements: Sequence[Measurement], results: Mapping[str, dict[str, Any]]) -> list[Point]:
    """Of the measurements whose tasks came to something; `results` by the tasks' digests."""
    there = [m for m in measurements if m.task.digest in results]
    return [point for m in there for point in m.points(results[m.task.digest])]
