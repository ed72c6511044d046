"""Hard cases: inputs on which a part loses digits, divides by zero, hangs or lies, each with the error it may have."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class HardCase:
    """One row of the table."""

    part: str
    name: str
    why: str  # what is hard about it
    done: str  # what the code does about it
    bound: float
    run: Callable[[], float]  # the worst error found; infinite for a value that is not finite. May raise
    is_slow: bool = False


@dataclass(frozen=True)
class Search:
    """Random inputs of one kind, made and shrunk by hypothesis."""

    part: str
    name: str
    inputs: Callable[[], Any]  # makes the strategy of an input whose repr is code
    bound: float
    error: Callable[[Any], float]


@dataclass
class Part:
    """The hard cases of one part of the project, in the order in which a module declares them."""

    name: str
    cases: list[HardCase] = field(default_factory=list)

    def case(
        self,
        *,
        why: str,
        done: str,
        bound: float = 0.0,
        each: Mapping[str, Any] | None = None,
        is_slow: bool = False,
    ) -> Callable[[Callable[..., float]], Callable[..., float]]:
        """Enter a function that returns the worst error found. Its name, in words, is the case's.

        Args:
            each: a case for each of these, by what tells it apart; the function gets the value.
        """

        def enter(function: Callable[..., float]) -> Callable[..., float]:
            name = function.__name__.replace("_", " ")
            if each is None:
                self.cases.append(HardCase(self.name, name, why, done, bound, function, is_slow))
            for label, value in (each or {}).items():
                run = _with(function, value)
                self.cases.append(HardCase(self.name, f"{name}: {label}", why, done, bound, run, is_slow))
            return function

        return enter


def _with(function: Callable[..., float], value: Any) -> Callable[[], float]:
    return lambda: function(value)
