"""Results of tasks become rows of the report's table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from aa4d.cost.panel import Measurement, Panel, Point
from aa4d.experiments.pareto import front

Row = dict[str, Any]


def rows_of(name: str, panel: Panel, found: Sequence[Point]) -> list[Row]:
    """A row for each point.

    `on_front` says that no other point is both at most as dear and at least as good; it is None where there is no
    quality to compare.
    """
    beaten_by_none = set()
    if panel.quality is not None:
        known = [(n, point.quality) for n, point in enumerate(found) if point.quality is not None]
        pairs = [(found[n].processor_s, panel.quality.better * quality) for n, quality in known]
        beaten_by_none = {known[n][0] for n in front(pairs, good=-1)}
    return [
        {
            "panel": name,
            "series": point.series,
            "point": point.label,
            "default": point.is_default,
            "per": panel.per,
            "processor_s": point.processor_s,
            "wall_s": point.wall_s,
            "measure": None if panel.quality is None else panel.quality.label,
            "better": None if panel.quality is None else {1: "higher", -1: "lower"}[panel.quality.better],
            "quality": point.quality,
            "on_front": None if point.quality is None else n in beaten_by_none,
            "more": point.more,
        }
        for n, point in enumerate(found)
    ]


def points_of(measurements: Sequence[Measurement], results: Mapping[str, dict[str, Any]]) -> list[Point]:
    """Of the measurements whose tasks came to something; `results` by the tasks' digests."""
    there = [m for m in measurements if m.task.digest in results]
    return [point for m in there for point in m.points(results[m.task.digest])]
