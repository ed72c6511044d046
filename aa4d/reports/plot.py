"""Plots as SVG: drawn in the page's own colors, dark or light, with what each point is under the pointer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from markupsafe import Markup

# Told apart on white and on black, by most people who see few colors too.
COLORS = ("#3b82c4", "#e07b39", "#3f9e5b", "#c94f4f", "#8a6bc1", "#a07a55", "#d16ba5", "#8a9a2f", "#2fa5b5", "#8a8a8a")
WIDTH, HEIGHT = 560.0, 300.0
LEFT, RIGHT, TOP, BOTTOM = 62.0, 12.0, 12.0, 46.0  # margins
MOST_POINTS = 400  # of a line; more are thinned out

Point = tuple[float, float]


@dataclass(frozen=True)
class Series:
    """Points that belong together; those with a coordinate that is not finite are left out."""

    name: str
    points: Sequence[Point]
    line: bool = False  # joined by a line, in their order
    dots: bool = True
    errors: Sequence[tuple[float | None, float | None]] = ()  # half a bar across and up, for each point
    notes: Sequence[str] = ()  # of each point, instead of its numbers
    labels: Sequence[str] = ()  # beside each point; "" for none
    star: bool = False  # what is done where nothing is said
    faint: bool = False  # gray, behind all others
    color: int | None = None  # a place in `COLORS`; None: that of the series
    dashed: bool = False


@dataclass(frozen=True)
class Plot:
    """Series over two axes."""

    title: str
    x: str
    y: str
    series: Sequence[Series]
    log_x: bool = False
    log_y: bool = False
    names: Sequence[str] = ()  # of x = 0, 1, 2, ...: the axis has names instead of numbers
    least_span: float = 0.0  # of y: what differs by less is not to look far apart
    steps: Sequence[tuple[float, str]] = ()  # a line up at x, and what begins there
    note: str = ""
    writes: ClassVar[str] = "plot"

    @property
    def legend(self) -> list[dict[str, str | Markup]]:
        colors = _colors(self.series)
        return [
            {
                "name": s.name,
                "marker": Markup('<svg viewBox="0 0 16 14" aria-hidden="true">{}</svg>').format(_key(s, c)),
            }
            for s, c in zip(self.series, colors, strict=True)
        ]

    @property
    def svg(self) -> Markup:
        return _svg(self)


def _colors(series: Sequence[Series]) -> list[str]:
    """The color of each; a faint one takes none of the others'."""
    found, place = [], 0
    for one in series:
        found.append(
            "currentColor"
            if one.faint or one.star
            else COLORS[(place if one.color is None else one.color) % len(COLORS)]
        )
        place += not one.faint
    return found


def _key(series: Series, color: str) -> Markup:
    line = _line([(0, 7), (16, 7)], series, color) if series.line else Markup()
    return line if series.dashed or not series.dots else line + _dot(8, 7, series, color, "")


def _svg(plot: Plot) -> Markup:
    there = [[p for p in s.points if _fits(p, plot)] for s in plot.series]
    if not any(there):
        return Markup('<p class="note">nothing to draw</p>')
    xs, ys = _extents(plot)
    across = _Axis(xs, LEFT, WIDTH - RIGHT, log=plot.log_x)
    up = _Axis(ys, HEIGHT - BOTTOM, TOP, log=plot.log_y)
    about = f"{plot.title or plot.y}: {plot.y} over {plot.x} of {', '.join(s.name for s in plot.series)}"
    parts = [Markup('<svg viewBox="0 0 {:g} {:g}" role="img" aria-label="{}">').format(WIDTH, HEIGHT, about)]
    parts += _frame(plot, across, up)
    for series, color in zip(plot.series, _colors(plot.series), strict=True):
        parts += _drawn(series, color, across, up, plot)
    return Markup("\n").join([*parts, Markup("</svg>")])


def _fits(point: Point, plot: Plot) -> bool:
    return all(math.isfinite(v) and (v > 0 or not log) for v, log in zip(point, (plot.log_x, plot.log_y), strict=True))


def _extents(plot: Plot) -> tuple[Point, Point]:
    xs, ys = [], []
    for series in plot.series:
        for n, point in enumerate(series.points):
            if _fits(point, plot):
                ex, ey = ((e or 0.0) for e in (series.errors[n] if series.errors else (0.0, 0.0)))
                xs += [x for x in (point[0] - ex, point[0] + ex) if x > 0 or not plot.log_x]
                ys += [y for y in (point[1] - ey, point[1] + ey) if y > 0 or not plot.log_y]
    named = (-0.5, len(plot.names) - 0.5)
    return named if plot.names else _padded(min(xs), max(xs), 0.0, log=plot.log_x), _padded(
        min(ys), max(ys), plot.least_span, log=plot.log_y
    )


def _padded(low: float, high: float, least: float, *, log: bool = False) -> Point:
    if log:
        factor = max((high / low) ** 0.08, 1.15)
        return low / factor, high * factor
    more = max((least - (high - low)) / 2, 0.0)
    low, high = low - more, high + more
    pad = 0.05 * (high - low) or 0.5 * max(abs(high), 1.0)
    return low - pad, high + pad


class _Axis:
    """From values to places."""

    def __init__(self, extent: Point, start: float, end: float, *, log: bool = False) -> None:
        self.extent, self._log = extent, log
        self._low, self._high = (math.log(v) for v in extent) if log else extent
        self._start, self._end = start, end

    def __call__(self, value: float) -> float:
        share = ((math.log(value) if self._log else value) - self._low) / (self._high - self._low)
        return self._start + share * (self._end - self._start)

    def ticks(self) -> list[float]:
        low, high = self.extent
        if not self._log:
            return _ticks(low, high)
        decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
        for steps in ((1,), (1, 3), (1, 2, 5)):
            found = [s * 10.0**d for d in decades for s in steps if low <= s * 10.0**d <= high]
            if len(found) >= 3:
                return found
        return found if len(found) > 1 else _ticks(low, high)


def _ticks(low: float, high: float, most: int = 6) -> list[float]:
    rough = (high - low) / most
    size = 10.0 ** math.floor(math.log10(rough))
    step = next(m * size for m in (1, 2, 5, 10) if m * size >= rough)
    return [n * step for n in range(math.ceil(low / step), math.floor(high / step) + 1)]


def _frame(plot: Plot, across: _Axis, up: _Axis) -> list[Markup]:
    bottom, right, parts = HEIGHT - BOTTOM, WIDTH - RIGHT, []
    for value in up.ticks():
        y = up(value)
        parts.append(Markup('<path class="grid" d="M{:.1f} {:.1f}H{:.1f}"/>').format(LEFT, y, right))
        parts.append(_text(LEFT - 6, y + 4, f"{value:.6g}", "end"))
    named = [(float(n), name) for n, name in enumerate(plot.names)]
    labels = named or [(value, f"{value:.6g}") for value in across.ticks()]
    room = (right - LEFT) / max(len(labels), 1) / 6.6  # letters
    for number, (value, label) in enumerate(labels):
        x = across(value)
        if not named:
            parts.append(Markup('<path class="grid" d="M{:.1f} {:.1f}V{:.1f}"/>').format(x, TOP, bottom))
        # Long names stand in two rows; one that is longer still is cut, and whole under the pointer.
        low = 16.0 * (number % 2) if named and max(len(name) for _, name in named) > room else 0.0
        fitted = label if len(label) <= 2 * room else label[: max(int(2 * room) - 1, 1)] + "…"
        parts.append(_text(x, bottom + 16 + low, fitted, "middle", label if fitted != label else ""))
    for number, (value, label) in enumerate(plot.steps):
        x = across(value)
        parts.append(
            Markup('<path class="frame" stroke-dasharray="4 3" d="M{:.1f} {:.1f}V{:.1f}"/>').format(x, TOP, bottom)
        )
        parts.append(_text(x + 4, TOP + 11 + 15 * number, label, "start"))
    parts.append(Markup('<path class="frame" d="M{0:.1f} {1:.1f}V{2:.1f}H{3:.1f}"/>').format(LEFT, TOP, bottom, right))
    if plot.x:
        parts.append(_text((LEFT + right) / 2, HEIGHT - 6, plot.x, "middle"))
    middle = (TOP + bottom) / 2
    parts.append(
        Markup('<text transform="translate(14 {:.1f}) rotate(-90)" text-anchor="middle">{}</text>').format(
            middle, plot.y
        )
    )
    return parts


def _text(x: float, y: float, text: str, anchor: str, whole: str = "") -> Markup:
    title = Markup("<title>{}</title>").format(whole) if whole else Markup()
    return Markup('<text x="{:.1f}" y="{:.1f}" text-anchor="{}">{}{}</text>').format(x, y, anchor, title, text)


def _drawn(series: Series, color: str, across: _Axis, up: _Axis, plot: Plot) -> list[Markup]:
    places = [(across(p[0]), up(p[1])) if _fits(p, plot) else None for p in series.points]
    parts = []
    if series.line:
        thin = max(1, -(-len(places) // MOST_POINTS))
        for piece in _pieces([p for n, p in enumerate(places) if n % thin == 0 or n == len(places) - 1]):
            parts.append(_line(piece, series, color))
    if not series.dots:
        return parts
    for number, (place, point) in enumerate(zip(places, series.points, strict=True)):
        if place is None:
            continue
        if series.errors:
            parts += _bars(point, series.errors[number], color, across, up, plot)
        where = plot.names[round(point[0])] if plot.names else f"{point[0]:.4g}"
        note = series.notes[number] if series.notes else f"{where}, {point[1]:.5g}"
        parts.append(_dot(*place, series, color, f"{series.name}: {note}"))
        if series.labels:
            parts.append(_label(*place, series.labels[number]))
    return parts


def _label(x: float, y: float, text: str) -> Markup:
    """Right of a point, or left where it would leave the plot."""
    side, anchor = (-7, "end") if x + 7 + 5.5 * len(text) > WIDTH - RIGHT else (7, "start")
    return Markup('<text class="label" x="{:.1f}" y="{:.1f}" text-anchor="{}">{}</text>').format(
        x + side, y - 5, anchor, text
    )


def _pieces(places: Sequence[Point | None]) -> list[list[Point]]:
    """Runs without a gap."""
    pieces: list[list[Point]] = [[]]
    for place in places:
        if place is None:
            pieces.append([])
        else:
            pieces[-1].append(place)
    return [piece for piece in pieces if len(piece) > 1]


def _line(places: Sequence[Point], series: Series, color: str) -> Markup:
    path = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in places)
    more = Markup(' stroke-dasharray="5 4"') if series.dashed else Markup()
    opacity = 0.35 if series.faint else 1
    return Markup('<path d="{}" fill="none" stroke="{}" stroke-width="1.6" stroke-opacity="{}"{}/>').format(
        path, color, opacity, more
    )


def _dot(x: float, y: float, series: Series, color: str, note: str) -> Markup:
    title = Markup("<title>{}</title>").format(note) if note else Markup()
    opacity = 0.4 if series.faint else 0.85
    if series.star:
        turns = [math.pi * n / 5 - math.pi / 2 for n in range(10)]
        radii = [8.5 if n % 2 == 0 else 3.6 for n in range(10)]
        path = (
            "M"
            + "L".join(
                f"{x + r * math.cos(a):.1f} {y + r * math.sin(a):.1f}" for a, r in zip(turns, radii, strict=True)
            )
            + "Z"
        )
        return Markup('<path d="{}" fill="{}" stroke="Canvas">{}</path>').format(path, color, title)
    return Markup('<circle cx="{:.1f}" cy="{:.1f}" r="{}" fill="{}" fill-opacity="{}">{}</circle>').format(
        x, y, 3 if series.faint or series.line else 4.5, color, opacity, title
    )


def _bars(
    point: Point, errors: tuple[float | None, float | None], color: str, across: _Axis, up: _Axis, plot: Plot
) -> list[Markup]:
    x, y = point
    parts = []
    if errors[0] and (x - errors[0] > 0 or not plot.log_x):
        parts.append(f"M{across(x - errors[0]):.1f} {up(y):.1f}H{across(x + errors[0]):.1f}")
    if errors[1] and (y - errors[1] > 0 or not plot.log_y):
        parts.append(f"M{across(x):.1f} {up(y - errors[1]):.1f}V{up(y + errors[1]):.1f}")
    return [Markup('<path d="{}" stroke="{}" stroke-width="1.2"/>').format(path, color) for path in parts]
