"""Seconds of the clock and of the processor."""

from __future__ import annotations

from collections.abc import Callable

from aa4d.training.spent import Spent


def least(work: Callable[[], object], repeats: int, warm_up: int = 1) -> Spent:
    """The least of each clock over so many calls: other programs only ever add to them."""
    found = []
    for number in range(warm_up + repeats):
        start = Spent.clocks()
        work()
        if number >= warm_up:
            found.append(Spent.clocks().since(start))
    return Spent(min(spent.seconds for spent in found), min(spent.processor_seconds for spent in found))
