"""Rows of measuring programs are kept for the same inputs and settings alone."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from aa4d.capture.reader import read_capture
from aa4d.capture.settings import PRESETS, CaptureSettings
from aa4d.errors import InputError
from aa4d.experiments import pose_noise
from aa4d.experiments.capture_accuracy import making_of
from aa4d.experiments.program import rows_of_tasks
from aa4d.graph.task import Task
from aa4d.graph.work import Job, perform
from aa4d.training.run_folder import what_counts
from tests.capture.test_content import change_frame
from tests.graph.toy import toy
from tests.training.short_run import SHORT

TINY = replace(SHORT, coarse_iterations=2, fine_iterations=2)


def test_a_row_of_pose_noise_says_how_far_off_the_cameras_were(toy_capture: Path, tmp_path: Path) -> None:
    truth = read_capture(toy_capture)
    identity = truth.identity.digest()
    assert pose_noise.noisy(truth, 1.0, 0.01, seed=1).identity.made_from == {"capture": identity}
    task = Task("pose-noise", "1 given", pose_noise.Noise(identity, 1.0, 1, what_counts(TINY), TINY, toy_capture))
    row = perform(Job(tmp_path, task, {}, {}), lambda _: None).result
    assert (row["noise"], row["refined"]) == (1.0, False)
    assert row["angle_before_deg"] > 0.3
    assert row["angle_after_deg"] == pytest.approx(row["angle_before_deg"])

    def digest(**other: Any) -> str:
        return replace(task, settings=replace(task.settings, **other)).digest

    changes: list[dict[str, Any]] = [
        {"level": 2.0},
        {"seed": 2},
        {"counts": what_counts(SHORT)},
        {"capture": "x"},
    ]
    assert len({task.digest, *(digest(**change) for change in changes)}) == 5
    assert digest(path=tmp_path) == task.digest


def test_what_capture_accuracy_makes_is_of_its_pictures_truth_and_settings(toy_capture: Path) -> None:
    def digest(**other: Any) -> str:
        settings = replace(CaptureSettings("fast", PRESETS["fast"]), **other)
        return Task("capture-accuracy", "toy", making_of(toy_capture, settings)).digest

    first = digest()
    assert digest() == first
    assert digest(size_px=99) != first
    change_frame(toy_capture)
    assert digest() != first


def test_rows_are_written_in_the_order_of_the_tasks_and_failures_end_the_program(tmp_path: Path) -> None:
    good, bad = toy("good", value=5), toy("bad", does="fail")
    assert [row["sum"] for row in rows_of_tasks([good], tmp_path)] == [5]
    with pytest.raises(InputError, match=r"1 of 2 tasks failed; first: .* bad: the toy is broken"):
        rows_of_tasks([bad, good], tmp_path)
    assert (tmp_path / "table.json").read_text().count('"sum"') == 1
