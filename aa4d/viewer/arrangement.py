"""Which of several models a window shows, and where in it each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

ONE, SIDE_BY_SIDE, DIFFERENCE = "one", "side by side", "difference"


@dataclass(frozen=True)
class Cell:
    """Pixels of the window."""

    left: int
    top: int
    width: int
    height: int

    def holds(self, x: float, y: float) -> bool:
        return self.left <= x < self.left + self.width and self.top <= y < self.top + self.height


def cells(count: int, width: int, height: int) -> list[Cell]:
    """`count` cells, row by row, of a shape as near to the window's as there is: nothing gets smaller than needed."""
    window = width / height

    def misfit(columns: int) -> float:
        rows = -(-count // columns)
        return abs(np.log(window * rows / columns / window)) + 1e-3 * rows

    columns = min(range(1, count + 1), key=misfit)
    rows = -(-count // columns)
    x = [round(width * i / columns) for i in range(columns + 1)]
    y = [round(height * i / rows) for i in range(rows + 1)]
    places = [divmod(i, columns) for i in range(count)]
    return [Cell(x[c], y[r], x[c + 1] - x[c], y[r + 1] - y[r]) for r, c in places]


@dataclass(frozen=True)
class Choice:
    """An entry of the menu "Show"."""

    name: str
    models: tuple[int, ...]
    arrangement: str


def choices(names: list[str]) -> list[Choice]:
    """Each model, all side by side, and the first less each of the others."""
    every = [Choice(name, (i,), ONE) for i, name in enumerate(names)]
    if len(names) > 1:
        every.append(Choice("side by side", tuple(range(len(names))), SIDE_BY_SIDE))
        every += [Choice(f"{names[0]} less {names[i]}", (0, i), DIFFERENCE) for i in range(1, len(names))]
    return every


def unlike(names: list[str]) -> list[str]:
    """Names that differ, by a number where two are the same."""
    seen: dict[str, int] = {}
    result = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        result.append(name if seen[name] == 1 else f"{name} ({seen[name]})")
    return result
