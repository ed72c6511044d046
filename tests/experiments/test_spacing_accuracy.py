"""The true pace of movers, of a square three metres long that slides at 13.3 m/s."""

from pathlib import Path

import numpy as np
import pytest

from aa4d.capture.reader import read_capture
from aa4d.errors import InputError
from aa4d.experiments.spacing_accuracy import true_pace


def test_the_true_pace_is_speed_over_length(toy_capture: Path) -> None:
    assert true_pace(read_capture(toy_capture)) == pytest.approx(13.3 / 3)


def test_what_stands_or_is_not_seen_has_no_pace(toy_capture: Path) -> None:
    path = toy_capture / "truth/tracks.npz"
    with np.load(path) as file:
        tracks = dict(file)
    np.savez(path, **{**tracks, "moving": np.zeros_like(tracks["moving"])})
    with pytest.raises(InputError, match="nothing moves in it"):
        true_pace(read_capture(toy_capture))
