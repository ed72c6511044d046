"""Where in a window each of several models is drawn."""

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
