"""Where the samples of a track may be joined to a curve: not over holes, and not where nobody could have driven."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEPS_WITHOUT, SHORTEST_GAP_S = 1.5, 0.5  # a hole is longer than so many of the table's usual steps, and than this
HARDEST_MPS2 = 9.0  # brakes on dry asphalt
WINDOW_S = 0.5  # the speed before and after a step is taken over this time: noise of centimetres is no speed
NOISE_M = 1.5  # what a position may be off by
LANE_M = (2.0, 5.0)  # sideways steps that are changes of lane
SIDEWAYS_MPS = 4.0  # faster than anybody changes lanes
CHANGE_S = 2.0  # what a change of lane takes


@dataclass(frozen=True)
class Jump:
    """A step that nobody could have driven: from sample `index` to the next, at `speed_mps`."""

    index: int
    speed_mps: float


def longest_step_s(steps_s: Array) -> float:
    """Up to which time between two samples a table with these steps [K] is taken for gapless."""
    return max(SHORTEST_GAP_S, STEPS_WITHOUT * float(np.median(steps_s))) if len(steps_s) else SHORTEST_GAP_S


def gaps(times_s: Array, longest_s: float) -> NDArray[np.int64]:
    """Indices of the samples after which there is a hole."""
    return np.flatnonzero(np.diff(times_s) > longest_s * (1 + 1e-9))


def jumps(times_s: Array, centres: Array, fastest_mps: float) -> list[Jump]:
    """Steps between samples [N], [N, 2] that are too far for `fastest_mps`, or for the speed before or after and the
    hardest acceleration there is."""
    steps = np.diff(times_s)
    way = np.hypot(*np.diff(centres, axis=0).T)
    allowed = fastest_mps * steps + NOISE_M
    # Samples at least `WINDOW_S` before the start of every step, and after its end; the first and the last for want.
    before = np.maximum(np.searchsorted(times_s, times_s[:-1] - WINDOW_S + 1e-9, side="right") - 1, 0)
    after = np.minimum(np.searchsorted(times_s, times_s[1:] + WINDOW_S - 1e-9, side="left"), len(times_s) - 1)
    for here, there in ((before, np.arange(len(steps))), (np.arange(1, len(times_s)), after)):
        window = times_s[there] - times_s[here]
        with np.errstate(divide="ignore", invalid="ignore"):
            speed = np.hypot(*(centres[there] - centres[here]).T) / window
        reach = speed * steps + 0.5 * HARDEST_MPS2 * steps * (steps + window) + NOISE_M
        allowed = np.where(window > 0, np.minimum(allowed, reach), allowed)
    return [Jump(int(i), float(way[i] / steps[i])) for i in np.flatnonzero(way > allowed)]


def with_smooth_lane_changes(times_s: Array, centres: Array, headings: Array) -> Array:
    """Centres [N, 2] in which a step sideways by a lane, at `headings` [N] (radians), takes `CHANGE_S` around it.

    SUMO moves a vehicle to the next lane from one step to the next, which at short steps is 80 m/s.
    """
    steps, way = np.diff(times_s), np.diff(centres, axis=0)
    across = np.stack([-np.sin(headings[:-1]) - np.sin(headings[1:]), np.cos(headings[:-1]) + np.cos(headings[1:])], -1)
    across /= np.maximum(np.hypot(*across.T), 1e-9)[:, None]
    left = (way * across).sum(axis=1)
    changes = (np.abs(left) >= LANE_M[0]) & (np.abs(left) <= LANE_M[1]) & (np.abs(left) > SIDEWAYS_MPS * steps)
    smooth = centres.copy()
    for i in np.flatnonzero(changes):
        middle = 0.5 * (times_s[i] + times_s[i + 1])
        length = min(CHANGE_S, 2 * (middle - times_s[0]), 2 * (times_s[-1] - middle))
        u = np.clip((times_s - middle) / length + 0.5, 0.0, 1.0)
        done = u**3 * (10 + u * (6 * u - 15))
        smooth += (done - (times_s > middle))[:, None] * left[i] * across[i]
    return smooth
