"""Traffic lights: green in the intervals that the scene lists, red otherwise. There is no amber."""

import math
from collections.abc import Sequence

Intervals = Sequence[tuple[float, float]]


def is_green(intervals: Intervals | None, time_s: float) -> bool:
    """Whether a light shows green. None is no light: one may always enter."""
    return intervals is None or any(start <= time_s < end for start, end in intervals)


def green_in_s(intervals: Intervals | None, time_s: float) -> float:
    """Seconds until the light next shows green: 0 if it does, infinity if it never will again or there is none."""
    if intervals is None:
        return math.inf
    if is_green(intervals, time_s):
        return 0.0
    return min((start - time_s for start, _ in intervals if start > time_s), default=math.inf)
