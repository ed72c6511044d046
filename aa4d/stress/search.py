"""The search for trouble: random inputs until the time is over, and the smallest one that breaks a bound."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from aa4d.errors import InputError
from aa4d.stress.cases import Search

EXAMPLES = 50  # in a round, after which the clock is looked at


@dataclass(frozen=True)
class Finding:
    """What a search came to."""

    search: Search
    tried: int
    worst: float  # error; over the bound only where `example` is given
    example: Any = None  # the smallest input that breaks the bound
    reason: str = ""


def search_for(
    searches: Sequence[Search],
    seed: int,
    seconds: float,
    told: Callable[[str], None],
    progress: Callable[[int, int], None],
) -> Iterator[Finding]:
    """Each search in its share of the time.

    Args:
        progress: is told the whole seconds that have passed, and how many there are.

    Raises:
        InputError: hypothesis is not installed.
    """
    try:
        import hypothesis  # noqa: F401
    except ModuleNotFoundError:
        raise InputError('--budget: the search needs hypothesis; pip install -e ".[dev]" brings it') from None
    share, total = seconds / len(searches), math.ceil(seconds)

    def advance(before: float, spent: float) -> None:
        progress(int(before + spent), total)

    for number, search in enumerate(searches):
        told(f"searching {search.part}: {search.name}")
        yield run_search(search, seed, share, partial(advance, number * share))
    progress(total, total)


def run_search(search: Search, seed: int, seconds: float, spent: Callable[[float], None] = lambda _: None) -> Finding:
    """Try inputs until the time is over or one breaks the bound, which is then made smaller.

    Args:
        spent: is told the seconds of its time that have passed, after each input.
    """
    from hypothesis import HealthCheck, Phase, given, settings
    from hypothesis import seed as with_seed
    from hypothesis.errors import UnsatisfiedAssumption

    tried, worst = 0, 0.0
    failure: tuple[Any, float, str] | None = None

    def attempt(value: Any) -> None:
        nonlocal tried, worst, failure
        tried += 1
        spent(min(time.monotonic() - begin, seconds))
        try:
            error, reason = float(search.error(value)), ""
        except UnsatisfiedAssumption:
            raise
        except Exception as raised:
            error, reason = math.inf, f"{type(raised).__name__}: {raised}"
        if not error <= search.bound:  # NaN as well
            failure = (value, error, reason)  # the last one that hypothesis shows is the smallest
            raise AssertionError(reason)
        worst = max(worst, error)

    begin = time.monotonic()
    while failure is None and (tried == 0 or time.monotonic() < begin + seconds):
        options = settings(
            max_examples=EXAMPLES,
            deadline=None,
            database=None,
            phases=(Phase.generate, Phase.shrink),
            suppress_health_check=list(HealthCheck),
            report_multiple_bugs=False,
            print_blob=False,
        )
        try:
            with_seed(seed)(options(given(search.inputs())(attempt)))()
        except AssertionError:
            break
        seed += 1
    if failure is None:
        return Finding(search, tried, worst)
    value, error, reason = failure
    return Finding(search, tried, error, value, reason)
