"""What a setting may be, declared in its annotation: `dssim: Annotated[float, Range(0, 1)] = 0.2`."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from importlib import import_module
from typing import Annotated


@dataclass(frozen=True)
class Range:
    """Bounds of a number, or of each number in a tuple: from `least`, or above it where `is_open`, to `most`."""

    least: float = -math.inf
    most: float = math.inf
    is_open: bool = False

    def holds(self, value: float) -> bool:
        return self.least <= value <= self.most and not (self.is_open and value == self.least)

    def __str__(self) -> str:
        if math.isinf(self.most):
            return "" if math.isinf(self.least) else f"{'above' if self.is_open else 'at least'} {_text(self.least)}"
        low = f"above {_text(self.least)} and up to" if self.is_open else f"from {_text(self.least)} to"
        return f"{low} {_text(self.most)}"


def _text(number: float) -> str:
    """Whole numbers in full: a bound that is rounded is none."""
    return str(number) if isinstance(number, int) else f"{number:.10g}"


@dataclass(frozen=True)
class NameIn:
    """A text that is one of a registry's names. The registry is imported when a value is checked, not before."""

    module: str
    registry: str  # a collection of names in `module`; of a mapping, its keys

    def names(self) -> tuple[str, ...]:
        return tuple(registered(self.module, self.registry))


def registered(module: str, registry: str) -> Collection[str]:
    """The collection `registry` of `module`, as it is now."""
    names: Collection[str] = getattr(import_module(module), registry)
    return names


Share = Annotated[float, Range(0, 1)]
Positive = Annotated[float, Range(0, 1_000_000, is_open=True)]
NotNegative = Annotated[float, Range(0, 1_000_000)]
Rate = Annotated[float, Range(0, 10, is_open=True)]  # of learning
Count = Annotated[int, Range(1, 10_000_000)]
Iterations = Annotated[int, Range(0, 10_000_000)]
Seed = Annotated[int, Range(0, 2**63 - 1)]  # torch takes no larger one
