"""What the report and the command tell of a capture."""

from __future__ import annotations

import base64
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aa4d.capture.clip import Clip, ClipFrame
from aa4d.capture.mapping import Cameras
from aa4d.capture.reader import read_capture
from aa4d.capture.report import _view
from aa4d.capture.schema import PinholeCamera
from aa4d.capture.selection import told
from aa4d.capture.summary import CaptureSummary
from aa4d.capture.writing import Cloud
from tests.capture import aerial


def test_the_report_needs_nothing_else(made: CaptureSummary) -> None:
    html = made.report.read_text()
    assert "<canvas" in html
    assert "9 of 9 frames have a pose" in html
    size = read_capture(made.folder).camera
    assert f"px in frames of {size.width}x{size.height}" in html
    assert not re.search(r'(src|href)="(?!data:)', html)


def test_what_the_command_tells(made: CaptureSummary, capsys: pytest.CaptureFixture[str]) -> None:
    from aa4d.commands.capture import tell

    world = replace(made.world, unit="metres", scale_from="satellite positions", gnss_error_m=0.344)
    tell(replace(made, folder=Path("my flight"), world=world, movers="boxes (UAVDT), 2 % of the pixels masked"))
    said = capsys.readouterr().out
    assert "scale: meters (satellite positions, the cameras 0.34 m from theirs (median))\n" in said
    assert "movers: boxes (UAVDT), 2 % of the pixels masked\n" in said
    assert "next:    aa4d train 'my flight' --out RUN\n" in said
    assert said.count("give --fov") == 1
    assert "pictures of one plane" not in said
    tell(replace(made, used=4 * made.frames))
    assert "next:    what the advice says, before you train on it\n" in capsys.readouterr().out


def test_cameras_of_a_later_attempt_are_told_with_what_it_begins_with(tmp_path: Path) -> None:
    frames = tuple(ClipFrame(f"{i}.png", f"{i}.jpg", 0.1 * i, i, 1.0, None) for i in range(3))
    clip = Clip(tmp_path, 320, 240, (320, 240), frames, ())
    cameras = Cameras(tmp_path, (0, 1), (), attempts=2, focal_was_kept=False, median_angle_deg=3.0)
    told_of_attempt, left_out = cameras.notes(clip)
    assert "attempt 2 of 3, which begins with a pair that sees 50 points under 4 degrees: depths are" in told_of_attempt
    assert left_out == "2.jpg left out: no pose could be found"
    assert replace(cameras, attempts=1, registered=(0, 1, 2)).notes(clip) == []


def test_many_notes_of_one_kind_are_one() -> None:
    few, many = ([(f"{i}.jpg", f"damage {i}") for i in range(count)] for count in (3, 31))
    assert told(few) == [f"{i}.jpg left out: damage {i}" for i in range(3)]
    assert told(many) == ["31 frames (0.jpg, 1.jpg, ... 30.jpg) left out, the first because: damage 0"]


def test_the_reports_view_holds_cloud_and_cameras_in_its_middle() -> None:
    generator = np.random.default_rng(0)
    cloud = Cloud(generator.uniform(-5, 5, (2000, 3)), np.zeros((2000, 3), np.uint8), np.ones(2000), np.arange(2000))
    centers = np.array([[60.0, y, 40.0] for y in np.linspace(-3, 3, 8)])  # all on one side, from far away
    right, down, ahead = (np.tile(axis, (8, 1)) for axis in np.eye(3))
    shown = _view(cloud, centers, right, down, ahead, PinholeCamera(320, 240, aerial.K))
    points, frusta = (np.frombuffer(base64.b64decode(shown[k]), "<f4").reshape(-1, 3) for k in ("points", "frusta"))
    assert np.linalg.norm(frusta.reshape(8, 5, 3)[:, 0], axis=1).max() <= 1.001
    assert (np.linalg.norm(points, axis=1) <= 1.001).mean() > 0.9
    middle = np.median(points, axis=0) + frusta.reshape(8, 5, 3)[:, 0].mean(axis=0)
    assert np.linalg.norm(middle) < 0.25  # about as far on one side as on the other
