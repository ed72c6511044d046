"""Running hard cases, in this process, one after another."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from aa4d.stress.cases import HardCase


@dataclass(frozen=True)
class Outcome:
    """What a case came to."""

    case: HardCase
    error: float  # the worst found; infinite where the case raised or met a value that is not finite
    seconds: float
    reason: str = ""  # what it raised

    @property
    def passes(self) -> bool:
        return self.error <= self.case.bound


def run_case(case: HardCase) -> Outcome:
    begin = time.perf_counter()
    try:
        error, reason = float(case.run()), ""
    except Exception as raised:  # whatever it is, it belongs into the case's row
        error, reason = math.inf, f"{type(raised).__name__}: {raised}"
    return Outcome(case, math.inf if math.isnan(error) else error, time.perf_counter() - begin, reason)


def run_cases(cases: Sequence[HardCase], progress: Callable[[int, int], None]) -> Iterator[Outcome]:
    for done, case in enumerate(cases):
        progress(done, len(cases))
        yield run_case(case)
    progress(len(cases), len(cases))
