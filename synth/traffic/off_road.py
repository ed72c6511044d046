"""How much of their way the vehicles of a table drive where no road is: whether the table lies on the street."""

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from synth.traffic.fleet import BODIES
from synth.traffic.tracks import Tracks

Array = NDArray[np.float64]
LOOK_EVERY_S = 0.2


def off_road_share(tracks: Tracks, raised: Sequence[Array], reach_m: float, duration_s: float) -> float:
    """Share of the way [0, 1] of all vehicles during a clip that lies on raised ground, polygons [P, 2], or beyond the
    scene's ground, `reach_m`; people on foot may walk anywhere."""
    drives = np.array([BODIES[kind].label != "pedestrian" for kind in tracks.kinds], dtype=bool)
    times = np.linspace(0.0, duration_s, max(2, round(duration_s / LOOK_EVERY_S) + 1))
    centres = np.stack([tracks.poses(float(t))[0] for t in times])  # [T, M, 2]
    here = np.stack([tracks.here(float(t)) for t in times]) & drives
    both = here[1:] & here[:-1]
    way = np.where(both, np.hypot(*np.moveaxis(np.diff(centres, axis=0), -1, 0)), 0.0)
    middle = (0.5 * (centres[1:] + centres[:-1]))[both]
    off = (np.abs(middle) > reach_m).any(axis=1)
    for polygon in raised:
        off |= inside(middle, polygon)
    total = float(way.sum())
    return float(way[both][off].sum()) / total if total > 0 else 0.0


def inside(points: Array, polygon: Array) -> NDArray[np.bool_]:
    """Which of the points [N, 2] lie in a polygon [P, 2]: crossings of a ray with its outline."""
    result = np.zeros(len(points), dtype=bool)
    for (x0, y0), (x1, y1) in itertools.pairwise([*polygon, polygon[0]]):
        spans = (y0 > points[:, 1]) != (y1 > points[:, 1])
        with np.errstate(divide="ignore", invalid="ignore"):
            result ^= spans & (points[:, 0] < (x1 - x0) * (points[:, 1] - y0) / (y1 - y0) + x0)
    return result
