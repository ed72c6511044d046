"""What a setting may be, declared in its annotation: `dssim: Annotated[float, Range(0, 1)] = 0.2`."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from importlib import import_module
from typing import Annotated


@dataclass(frozen=True)
class Range:
    """Bounds of a number, or of each number in a tuple; both are allowed."""

    least: float
    most: float

    def holds(self, value: float) -> bool:
        return self.least <= value <= self.most

    def __str__(self) -> str:
        return f"from {_text(self.least)} to {_text(self.most)}"


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
    """The collection `registry` of `module`, or what a function of that name returns, as it is now."""
    names = getattr(import_module(module), registry)
    collection: Collection[str] = names() if callable(names) else names
    return collection


Share = Annotated[float, Range(0, 1)]
Positive = Annotated[float, Range(1e-12, 1_000_000)]
NotNegative = Annotated[float, Range(0, 1_000_000)]
Rate = Annotated[float, Range(1e-12, 10)]  # of learning
Pixels = Annotated[float, Range(0.01, 1000)]
Count = Annotated[int, Range(1, 10_000_000)]
Width = Annotated[int, Range(1, 2048)]  # of a network or a plane
Iterations = Annotated[int, Range(0, 10_000_000)]
Seed = Annotated[int, Range(0, 2**63 - 1)]  # torch takes no larger one
