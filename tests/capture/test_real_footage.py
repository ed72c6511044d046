"""Real frames, where they are at hand: a UAV over a campus, and photographs with satellite positions."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aa4d.capture.make import make_capture
from aa4d.capture.reader import read_capture
from aa4d.capture.settings import PRESETS, CaptureSettings
from aa4d.capture.workspace import Progress

DATA = Path(__file__).parents[3] / "shared/data"
S1001, BEACH = DATA / "uavdt_S1001", DATA / "brighton_beach/images"
SETTINGS = CaptureSettings("fast", PRESETS["fast"], size_px=512, threads=2)


def silent(*_: object) -> Progress:
    return lambda *_: None


@pytest.mark.slow
@pytest.mark.skipif(not S1001.is_dir(), reason="no frames of UAVDT S1001")
def test_fifteen_frames_of_a_uav_over_a_campus(tmp_path: Path) -> None:
    frames = tmp_path / "frames"
    frames.mkdir()
    for path in sorted((S1001 / "frames").iterdir())[:15]:
        shutil.copyfile(path, frames / path.name)
    made = make_capture(frames, tmp_path / "capture", SETTINGS, S1001 / "S1001_gt.txt", silent)
    assert made.frames == 15
    assert made.reprojection_px < 0.6
    capture = read_capture(made.folder)
    # Every third frame of a video of 30 frames a second.
    assert capture.fps == pytest.approx(10)
    steps = np.diff([-f.viewmat[:3, :3].T @ f.viewmat[:3, 3] for f in capture.frames], axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    assert lengths.max() < 3 * np.median(lengths)


@pytest.mark.slow
@pytest.mark.skipif(not BEACH.is_dir(), reason="no photographs of Brighton beach")
def test_photographs_with_satellite_positions_give_metres(tmp_path: Path) -> None:
    made = make_capture(BEACH, tmp_path / "capture", replace(SETTINGS, movers="off"), None, silent)
    assert made.frames == 18
    assert made.world.unit == "metres"
    assert made.world.gnss_error_m is not None
    assert made.world.gnss_error_m < 5
    capture = read_capture(made.folder)
    heights = np.array([(-f.viewmat[:3, :3].T @ f.viewmat[:3, 3])[2] for f in capture.frames])
    # One level survey flight, looking down: the ground lies level below it.
    assert heights.std() < 0.05 * heights.mean()
    down = np.array([f.viewmat[2, :3] for f in capture.frames])
    assert (down[:, 2] < -0.9).all()
