"""The contact sheet."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("bpy", reason="needs the bpy module")
from aa4d.reports.contact_sheet import plot

SCRIPT = Path(__file__).resolve().parents[2] / "synth" / "sheet.py"


def test_a_sheet_shows_and_times_the_middle_of_a_clip(tiny_scene: Path, tmp_path: Path) -> None:
    command = [sys.executable, str(SCRIPT), str(tiny_scene), "--out", str(tmp_path / "sheet"), "--frames", "3"]
    result = subprocess.run(command, capture_output=True, text=True, timeout=240, check=False)
    assert result.returncode == 0, result.stderr
    found = json.loads((tmp_path / "sheet" / "sheet.json").read_text())
    (row,) = found["scenes"]
    assert row["frames"] == 6
    frames = row["clip_s"] - row["setup_s"] - row["load_s"]
    assert frames == pytest.approx(6 * (row["picture_s"] + row["truth_s"]), abs=0.2)
    with np.load(tmp_path / "sheet" / "tiny" / "truth.npz") as truth:
        assert np.isfinite(truth["flow_forward"]).all(axis=-1).mean() > 0.9
    plot(tmp_path / "sheet" / "sheet.json", tmp_path / "sheet" / "sheet.jpg")
    assert (tmp_path / "sheet" / "sheet.jpg").stat().st_size > 5000


def test_a_sheet_of_too_few_frames_is_refused(tiny_scene: Path, tmp_path: Path) -> None:
    for number, words in (("2", "must be at least 3"), ("7", "has 6 frames; a sheet takes 7")):
        command = [sys.executable, str(SCRIPT), str(tiny_scene), "--out", str(tmp_path / "sheet"), "--frames", number]
        result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
        assert result.returncode == 2
        assert words in result.stderr
        assert not (tmp_path / "sheet").exists()
