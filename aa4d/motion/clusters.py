"""Points that move as one body: agglomeration of followed points that are neighbors and never drift apart.

A difference at any time splits two bodies for good; agreement at all common times joins them. The drift of a cluster
against another is summed over all their common steps, so that a slow parting counts and a moment's noise does not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from aa4d.motion.points import Points

NEAR_PX = 5.0  # between neighbors, in the picture
PAIR_DRIFT_PX = 2.5  # of two points against each other
DRIFT_PX = 2.0  # of two clusters against each other
TURN = 0.12  # more for what is further apart: a body turns
FAR_PX = 20.0  # up to here
CHANGE = 0.3  # share of the drift that counts although the distance is kept: what turns
JERK_PX = 1.2  # a frame, of velocity differences at a single step between clusters

Floats = NDArray[np.float32]
Ints = NDArray[np.int64]


def clusters(points: Points, gaps: Ints) -> Ints:
    """[N]: the number of the body of each point, from 0; gaps [V - 1] in clip frames."""
    count = len(points)
    if not count:
        return np.zeros(0, np.int64)
    steps = np.diff(points.places, axis=1)  # [N, V - 1, 2] pixels on the ground
    known = np.isfinite(steps[..., 0])
    pairs = _neighbors(points)
    drift, overlap = _pair_drift(steps, known, pairs)
    good = (overlap > 0) & (drift < PAIR_DRIFT_PX)
    pairs, drift, overlap = pairs[good], drift[good], overlap[good]
    order = np.argsort(drift - 0.25 * np.minimum(overlap, 12), kind="stable")
    return _agglomerated(points, np.where(known[..., None], steps, 0.0).astype(np.float64), known, pairs[order], gaps)


def _neighbors(points: Points) -> Ints:
    """[P, 2]: pairs of points that are near each other in some frame."""
    count = len(points)
    found = [np.zeros(0, np.int64)]
    for v in range(points.pixels.shape[1]):
        here = np.flatnonzero(points.alive[:, v])
        if len(here) > 1:
            pairs = cKDTree(points.pixels[here, v]).query_pairs(NEAR_PX, output_type="ndarray")
            pairs = np.sort(here[pairs], axis=1)
            found.append(pairs[:, 0] * count + pairs[:, 1])
    keys = np.unique(np.concatenate(found))
    return np.stack([keys // count, keys % count], axis=1)


def _pair_drift(steps: Floats, known: NDArray[np.bool_], pairs: Ints) -> tuple[Floats, Ints]:
    """[P] pixels that the two of a pair part over their common steps at most, and how many those are."""
    drift, overlap = np.zeros(len(pairs), np.float32), np.zeros(len(pairs), np.int64)
    for start in range(0, len(pairs), 20_000):
        a, b = pairs[start : start + 20_000].T
        both = known[a] & known[b]
        apart = np.cumsum(np.where(both[..., None], steps[a] - steps[b], 0), axis=1)
        reach = np.maximum(apart.max(1), 0) - np.minimum(apart.min(1), 0)
        drift[start : start + 20_000] = np.linalg.norm(reach, axis=1)
        overlap[start : start + 20_000] = both.sum(1)
    return drift, overlap


def _agglomerated(
    points: Points, steps: NDArray[np.float64], known: NDArray[np.bool_], pairs: Ints, gaps: Ints
) -> Ints:
    count = len(points)
    parent = np.arange(count)
    size = np.ones(count, int)
    number = known.astype(np.float64)  # [N, S] points of the cluster that know a step
    total = steps.copy()
    seen = points.alive.astype(np.float64)
    place = np.where(points.alive[..., None], points.places, 0.0).astype(np.float64)
    refused: dict[tuple[int, int], int] = {}

    def root(i: int) -> int:
        while parent[i] != i:
            parent[i] = parent[parent[i]]
            i = int(parent[i])
        return i

    for i, j in pairs.tolist():
        a, b = root(i), root(j)
        if a == b:
            continue
        key = (min(a, b), max(a, b))
        if refused.get(key, -1) * 1.3 >= size[a] + size[b]:
            continue
        if not _together(number[a], total[a], number[b], total[b], seen[a], place[a], seen[b], place[b], gaps):
            refused[key] = int(size[a] + size[b])
            continue
        if size[a] < size[b]:
            a, b = b, a
        parent[b] = a
        size[a] += size[b]
        number[a] += number[b]
        total[a] += total[b]
        seen[a] += seen[b]
        place[a] += place[b]
    roots = np.array([root(i) for i in range(count)])
    return np.asarray(np.unique(roots, return_inverse=True)[1], np.int64)


def _together(
    number_a: NDArray[np.float64],
    total_a: NDArray[np.float64],
    number_b: NDArray[np.float64],
    total_b: NDArray[np.float64],
    seen_a: NDArray[np.float64],
    place_a: NDArray[np.float64],
    seen_b: NDArray[np.float64],
    place_b: NDArray[np.float64],
    gaps: Ints,
) -> bool:
    common = (number_a > 0) & (number_b > 0)
    if not common.any():
        return True
    apart = total_a[common] / number_a[common, None] - total_b[common] / number_b[common, None]
    both = (seen_a > 0) & (seen_b > 0)
    offset = (place_a[both] / seen_a[both, None] - place_b[both] / seen_b[both, None]).mean(0)
    distance = min(float(np.hypot(*offset)), FAR_PX)
    drift = np.cumsum(apart, axis=0)
    drift = np.concatenate([np.zeros((1, 2)), drift])
    drift = drift - drift.mean(0)
    length = np.hypot(*drift.T)
    change = np.abs(np.hypot(*(offset + drift).T) - np.hypot(*offset))
    allowed = DRIFT_PX + TURN * distance
    if float((change + CHANGE * length).max()) * 2 > allowed * 1.3 and float(length.max()) * 2 > DRIFT_PX:
        return False
    # A jump in one step counts where both clusters are sure of it.
    sure = np.minimum(number_a[common], number_b[common]) >= 4
    jerk = np.hypot(*apart.T) / gaps[common]
    return not bool((jerk[sure] > JERK_PX + TURN * distance).any())
