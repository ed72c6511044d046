"""Traffic lights of a crossing: green in the intervals that the scene lists, red otherwise."""

from synth.spec import Signal


def is_green(signal: Signal | None, arm: str, time_s: float) -> bool:
    """Whether traffic from `arm` may enter at `time_s`. Without a signal it always may."""
    if signal is None:
        return True
    intervals = signal.east_west_green_s if arm in ("east", "west") else signal.north_south_green_s
    return any(start <= time_s < end for start, end in intervals)
