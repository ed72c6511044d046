"""Two looks at the same frames, joined: what only the first one saw is kept where the clean static scene lacks it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aa4d.motion.tracks import Tracks

KNOWN = 0.3  # of its labels on tracks of the second look: it is one of those
CLEAR = 0.5  # of its labels on what the clean static scene does not show: a rim or a shadow was only taken for a mover

Mask = NDArray[np.bool_]


def joined(first: Tracks, second: Tracks, missing: Mask) -> Tracks:
    """The tracks of the second look, and those of the first that it lacks.

    Args:
        missing: [V, H, W], what the static scene of the second look does not show, shadows apart.
    """
    labels, keep = second.labels.copy(), []
    for g in range(len(first)):
        mine = first.labels == g + 1
        if mine.any() and (second.labels[mine] > 0).mean() < KNOWN and missing[mine].mean() > CLEAR:
            keep.append(g)
            labels[mine & (labels == 0)] = len(second) + len(keep)
    return Tracks(
        tuple(f"mover {g + 1}" for g in range(len(second) + len(keep))),
        np.concatenate([second.control, first.control[keep]]),
        np.concatenate([second.shown, first.shown[keep]]),
        second.up,
        labels,
        second.moving | (labels > 0),
    )
