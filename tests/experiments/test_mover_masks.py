"""Scores of masks of movers, by counting pixels."""

from pathlib import Path

import numpy as np
import pytest

from aa4d.capture.reader import read_capture
from aa4d.errors import InputError
from aa4d.experiments.mover_masks import Count, measure
from tests.toy_capture import write_toy_capture


def test_scores_are_shares_of_pixels_and_vehicles() -> None:
    moving, mask = np.zeros((64, 64), bool), np.zeros((64, 64), bool)
    moving[10:14, 10:20] = True
    mask[10:14, 10:15] = True  # half of it
    mask[10:14, 20] = True  # beside it: no fault
    mask[40:42, 40:45] = True  # far from it
    count = Count()
    left, right = moving.copy(), moving.copy()
    left[:, 15:], right[:, :15] = False, False
    count.add(mask, moving, [moving, left, right])
    row = count.row()
    assert row["vehicles"] == pytest.approx(2 / 3)
    assert row["recall"] == pytest.approx(20 / 40)
    assert row["precision"] == pytest.approx(24 / 34)
    # Near: a pixel around, a disc of radius ceil(10 / 640 * 64) = 1: all but the corners of the rectangle around it.
    assert row["still_masked"] == pytest.approx(10 / (64 * 64 - (6 * 12 - 4)))
    assert Count().row() == dict.fromkeys(("vehicles", "recall", "precision", "still_masked", "cpu_s"))


def test_each_look_has_a_row_and_a_capture_without_truth_is_refused(tmp_path: Path) -> None:
    capture = read_capture(write_toy_capture(tmp_path / "capture", frames=6, travel_m=4))
    rows = measure(capture)
    assert [(row["capture"], row["look"]) for row in rows] == [("capture", look) for look in ("first", "auto", "twice")]
    assert all(row["cpu_s"] > 0 for row in rows)
    bare = read_capture(write_toy_capture(tmp_path / "other", frames=6))
    with pytest.raises(InputError, match="has no true tracks"):
        measure(type(bare)(**{**vars(bare), "tracks": None}))
