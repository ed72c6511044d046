"""What is burned into a film is left out on demand, by the real command."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from aa4d.capture.overlay import still_in
from aa4d.capture.reader import read_capture
from aa4d.capture.truth import left_out
from aa4d.cli import main
from tests.capture import aerial
from tests.capture.test_overlay import with_text

QUICK = ("--fps", "10", "--movers", "off", "--threads", "1", "--longest-px", "320")


def capture(monkeypatch: pytest.MonkeyPatch, source: Path, out: Path, *options: str) -> None:
    monkeypatch.setattr(sys, "argv", ["aa4d", "capture", str(source), "--out", str(out), *QUICK, *options])
    main()


def test_text_is_masked_for_features_and_training(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import pycolmap

    source = aerial.write(tmp_path / "frames", with_text(aerial.pictures(aerial.arc())))
    out = tmp_path / "capture"
    capture(monkeypatch, source, out, "--overlay", "leave-out")
    made = read_capture(out)
    mask = left_out(made, 3)
    assert mask is not None
    assert 0.005 < mask.mean() < 0.08
    still = still_in(sorted(source.glob("*.png")))
    assert still is not None
    rows, columns = np.nonzero(still)
    # The camera has no distortion to speak of: frames of the capture are nearly the source's.
    scale = made.camera.width / aerial.WIDTH
    inside = mask[
        (rows * scale).astype(int).clip(0, mask.shape[0] - 1), (columns * scale).astype(int).clip(0, mask.shape[1] - 1)
    ]
    assert inside.mean() > 0.95
    with pycolmap.Database.open(out / "work/features/database.db") as database:
        found = np.concatenate([database.read_keypoints(i.image_id)[:, :2] for i in database.read_all_images()])
    text = (found[:, 0] > 10) & (found[:, 0] < 44) & (found[:, 1] > 212) & (found[:, 1] < 224)
    assert not text.any()
    assert "leave_out=true" in (out / "report.html").read_text()


def test_by_default_it_is_only_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = aerial.write(tmp_path / "frames", with_text(aerial.pictures(aerial.arc())))
    capture(monkeypatch, source, tmp_path / "capture")
    assert left_out(read_capture(tmp_path / "capture"), 3) is None
    assert "--overlay leave-out" in (tmp_path / "capture/report.html").read_text()
