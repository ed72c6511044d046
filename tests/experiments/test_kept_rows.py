"""Rows that are kept are kept for the same inputs and settings alone."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from aa4d.capture.reader import read_capture
from aa4d.capture.settings import PRESETS, CaptureSettings
from aa4d.errors import InputError
from aa4d.experiments import capture_accuracy, pose_noise
from aa4d.files import write_json
from tests.capture.test_content import change_frame
from tests.training.short_run import SHORT

TINY = replace(SHORT, coarse_iterations=2, fine_iterations=2)


def test_a_row_of_pose_noise_is_kept_for_its_settings_alone(toy_capture: Path, tmp_path: Path) -> None:
    truth = read_capture(toy_capture)
    given = pose_noise.noisy(truth, 1.0, 0.01, seed=1)
    assert given.identity.made_from == {"capture": truth.identity.digest()}
    row = pose_noise.measure(truth, given, TINY, tmp_path / "run")
    write_json(tmp_path / "run/result.json", row | {"psnr": 99.0})
    assert pose_noise.measure(truth, given, TINY, tmp_path / "run")["psnr"] == 99.0
    for other, config in (
        (given, replace(TINY, seed=1)),
        (given, replace(TINY, fine_iterations=3)),
        (pose_noise.noisy(truth, 1.0, 0.01, seed=2), TINY),
    ):
        with pytest.raises(InputError, match="holds a run with another"):
            pose_noise.measure(truth, other, config, tmp_path / "run")
    of_old = {key: value for key, value in row.items() if key != "identity"}
    write_json(tmp_path / "run/result.json", of_old | {"psnr": 99.0})
    assert pose_noise.measure(truth, given, TINY, tmp_path / "run") == row


def test_a_row_of_capture_accuracy_is_kept_for_its_input_and_settings_alone(toy_capture: Path, tmp_path: Path) -> None:
    settings = CaptureSettings("fast", PRESETS["fast"])
    identity = capture_accuracy._identity(toy_capture / "frames", read_capture(toy_capture), settings)
    row = {"input": "capture", "identity": identity.as_json()}
    write_json(tmp_path / "row.json", row)
    assert capture_accuracy.measure(toy_capture, tmp_path / "row", settings) == row
    with pytest.raises(InputError, match=r"row\.json: was measured from another input or with other settings; delete"):
        capture_accuracy.measure(toy_capture, tmp_path / "row", replace(settings, size_px=99))
    change_frame(toy_capture)
    with pytest.raises(InputError, match=r"row\.json: was measured from another input"):
        capture_accuracy.measure(toy_capture, tmp_path / "row", settings)
    assert json.loads((tmp_path / "row.json").read_text()) == row
