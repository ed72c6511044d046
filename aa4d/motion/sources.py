"""Where tracks of movers come from, by the name that `--tracks` takes. What a finder needs is imported when it runs."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from aa4d.errors import InputError

if TYPE_CHECKING:
    from aa4d.capture.reader import Capture
    from aa4d.capture.truth import Boxes
    from aa4d.motion.observations import Observations
    from aa4d.motion.tracks import Tracks


def find_best(capture: Capture, observed: Observations, earlier: Tracks | None) -> Tracks:
    """By annotated boxes where they follow several movers (a file with one target follows one of many)."""
    import numpy as np

    from aa4d.capture.truth import boxes_of

    boxes = boxes_of(capture)
    follows_several = boxes is not None and len(np.unique(boxes.target[boxes.target >= 0])) > 1
    return (find_by_boxes if follows_several else find_in_pictures)(capture, observed, earlier)


def find_in_pictures(_capture: Capture, observed: Observations, earlier: Tracks | None) -> Tracks:
    from aa4d.motion.finder import find_tracks

    return find_tracks(observed, earlier)


def find_by_boxes(capture: Capture, observed: Observations, _earlier: Tracks | None) -> Tracks:
    from aa4d.motion.boxes import box_tracks

    return box_tracks(observed, followed_boxes(capture))


def take_truth(capture: Capture, _observed: Observations, _earlier: Tracks | None) -> Tracks:
    from aa4d.motion.truth import truth_tracks

    return truth_tracks(capture, capture.of_split("train"))


SOURCES: dict[str, Callable[[Capture, Observations, Tracks | None], Tracks]] = {
    "auto": find_best,
    "pictures": find_in_pictures,
    "boxes": find_by_boxes,
    "truth": take_truth,  # known before anything is observed
}


def followed_boxes(capture: Capture) -> Boxes:
    """Raises InputError where annotators followed no mover."""
    from aa4d.capture.truth import boxes_of

    boxes = boxes_of(capture)
    if boxes is None or not (boxes.target >= 0).any():
        raise InputError(
            f"{capture.folder}: has no boxes that follow movers from frame to frame; use --tracks pictures, or make "
            "the capture with `aa4d capture --annotations`"
        )
    return boxes
