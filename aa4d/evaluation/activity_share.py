"""Does aggregation lean on spatio-temporal planes where the ground is truly active? A rank correlation over anchors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from aa4d.capture.reader import Capture
from aa4d.capture.truth import read_array
from aa4d.errors import InputError
from aa4d.evaluation.activity import CLASSES
from aa4d.field.planes import SPATIOTEMPORAL
from aa4d.methods.capabilities import WeighsPlanes
from aa4d.methods.model_file import LoadedModel

ACTIVITY = "truth/activity.npz"
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
    if not (capture.folder / ACTIVITY).is_file() or not isinstance(loaded.model, WeighsPlanes) or loaded.is_static:
        return None
    sampled = [loaded.model.plane_weights(float(t)) for t in np.linspace(0, 1, TIMES)]
    weights = [w[:, SPATIOTEMPORAL].sum(dim=1).numpy(force=True) for w in sampled if w is not None]
    if len(weights) < TIMES:
        return None
    share = np.mean(weights, axis=0)
    matrix = loaded.frame.matrix()
    places = loaded.model.resting(None).numpy(force=True).astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    activity = true_activity(capture, places)
    counts = np.isfinite(activity)
    if (group := loaded.model.group) is not None:
        counts &= (group < 0).numpy(force=True)
    share, activity = share[counts], activity[counts]
    if len(share) < FEWEST or np.ptp(share) == 0 or np.ptp(activity) == 0:
        return None
    return float(stats.spearmanr(share, activity).statistic)


def true_activity(capture: Capture, places: Array) -> Array:
    """Share of the frames in which the ground cell under each place [N, 3] (world metres) is active, [N]; NaN where
    there is no cell, or no frame sees it. Raises InputError for damaged truth."""
    path = capture.folder / ACTIVITY
    active, labels, origin, side = (
        read_array(path, name) for name in ("cell_active", "cell_label", "origin_m", "cell_m")
    )
    if active.ndim != 3 or labels.shape != active.shape[1:] or origin.shape != (2,) or side.shape != ():
        raise InputError(f"{path}: its arrays do not fit together; make the capture again")
    rows, columns = labels.shape
    cell = np.floor((places[:, :2] - origin) / side)
    inside = ((cell >= 0) & (cell < (columns, rows))).all(axis=1)
    column, row = np.where(inside[:, None], cell, 0).astype(np.int64).T
    seen = inside & (labels[row, column] != CLASSES.index("unseen"))
    return np.where(seen, active[:, row, column].mean(axis=0), np.nan)
