"""Does aggregation lean on spatio-temporal planes where the ground is truly active? A rank correlation over anchors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from aa4d.capture.reader import Capture
from aa4d.evaluation.activity import CLASSES
from aa4d.evaluation.ground_cells import GroundCells, ground_cells
from aa4d.field.planes import SPATIOTEMPORAL
from aa4d.methods.capabilities import WeighsPlanes
from aa4d.methods.model_file import LoadedModel

TIMES = 16  # at which the weights are looked up, evenly over the clip
FEWEST = 10  # anchors, below which a correlation says nothing

Array = NDArray[np.float64]


def rank_correlation(loaded: LoadedModel, capture: Capture) -> float | None:
    """Spearman's, between the mean over time of an anchor's weight on planes with t, and the share of time in which
    the ground cell below it is active. Over anchors that belong to the world and stand over a cell of the truth.

    Returns:
        None where the model weighs no planes, the capture has no truth of activity, or either is the same everywhere.

    Raises:
        InputError: the truth is damaged.
    """
    if not isinstance(loaded.model, WeighsPlanes) or loaded.is_static or (cells := ground_cells(capture)) is None:
        return None
    sampled = [loaded.model.plane_weights(float(t)) for t in np.linspace(0, 1, TIMES)]
    weights = [w[:, SPATIOTEMPORAL].sum(dim=1).numpy(force=True) for w in sampled if w is not None]
    if len(weights) < TIMES:
        return None
    share = np.mean(weights, axis=0)
    matrix = loaded.frame.matrix()
    places = loaded.model.resting(None).numpy(force=True).astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    activity = true_activity(cells, places)
    counts = np.isfinite(activity)
    if (group := loaded.model.group) is not None:
        counts &= (group < 0).numpy(force=True)
    share, activity = share[counts], activity[counts]
    if len(share) < FEWEST or np.ptp(share) == 0 or np.ptp(activity) == 0:
        return None
    return float(stats.spearmanr(share, activity).statistic)


def true_activity(cells: GroundCells, places: Array) -> Array:
    """Share of the frames in which the ground cell under each place [N, 3] (world meters) is active, [N]; NaN where
    there is no cell, or no frame sees it."""
    at = cells.below(places)
    seen = (at >= 0) & (cells.label.ravel()[at] != CLASSES.index("unseen"))
    return np.where(seen, cells.active.mean(axis=0).ravel()[at], np.nan)
