"""One row of a table of tracks, whatever the table's format, and the checks that all formats share."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from synth.errors import InputError


@dataclass(frozen=True)
class Row:
    """Where somebody is at a time of the table: the centre of the footprint, or `ahead_m` before it."""

    time_s: float
    x: float
    y: float
    heading: float  # radians, counter-clockwise from east; NaN: unknown
    kind: str
    ahead_m: float = 0.0  # along the heading, from the centre to the point that the table gives


def require(path: Path, columns: Sequence[str], needed: tuple[str, ...]) -> None:
    """Raises InputError where columns are missing."""
    missing = [name for name in needed if name not in columns]
    if missing:
        raise InputError(f"{path}: the columns {', '.join(missing)} are missing; needed are {', '.join(needed)}.")


def number(text: str | None, where: str) -> float:
    """A finite number, or InputError."""
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{where}: {text!r} must be a finite number.")
    return value
