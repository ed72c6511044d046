"""The long run: a capture that is as hostile as it says, and rows of norms that survive a stop."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from aa4d.capture.reader import read_capture, read_images
from aa4d.stress import hostile
from aa4d.stress.long_run import EVERY, Norms, long_run
from aa4d.training.watchdog import NotFinite


def test_the_capture_is_as_hostile_as_it_says(tmp_path: Path) -> None:
    hostile.write_hostile_capture(tmp_path)
    capture = read_capture(tmp_path)
    images = read_images(capture, list(range(hostile.FRAMES)))
    assert (images[hostile.WHITE] == 255).all()
    assert (images[hostile.BLACK] == 0).all()
    assert {hostile.WHITE, hostile.BLACK, hostile.AT_WALL} <= set(capture.of_split("train"))
    before, after = (images[i].mean() for i in (hostile.BRIGHTER_FROM - 1, hostile.BRIGHTER_FROM))
    assert after > 1.5 * before
    sky = np.round(255 * np.array(hostile.SKY)).astype(np.uint8)
    assert 0.1 < (images[0] == sky).all(axis=-1).mean() < 0.9
    assert len(np.unique(capture.points, axis=0)) * hostile.COPIES == len(capture.points)
    places = np.array([-f.viewmat[:3, :3].T @ f.viewmat[:3, 3] for f in capture.frames])
    assert hostile.WALL_X_M - places[:, 0].max() == pytest.approx(hostile.CLOSEST_M)


def optimiser(*values: float) -> torch.optim.Adam:
    return torch.optim.Adam([{"params": [torch.nn.Parameter(torch.tensor(values))], "name": "planes"}])


def test_a_run_that_continues_keeps_its_rows_and_repeats_none(tmp_path: Path) -> None:
    norms = Norms(tmp_path / "norms.json", 0)
    for step in range(1, 2 * EVERY + 1):
        norms.add(step, float(step), 20.0, 7, optimiser(3.0, -4.0))
    assert [row["step"] for row in norms.rows] == [EVERY, 2 * EVERY]
    assert norms.rows[0]["groups"]["planes"] == {"rms": pytest.approx(12.5**0.5), "largest": 4.0}
    assert (norms.rows[1]["loss"], norms.rows[1]["largest_loss"]) == (1.5 * EVERY + 0.5, 2 * EVERY)
    again = Norms(tmp_path / "norms.json", EVERY + 50)  # the last checkpoint
    assert [row["step"] for row in again.rows] == [EVERY]


def test_a_value_that_is_not_finite_is_found_with_its_group(tmp_path: Path) -> None:
    with pytest.raises(NotFinite) as found:
        Norms(tmp_path / "norms.json", 0).add(EVERY, 0.1, 20.0, 7, optimiser(1.0, float("nan")))
    assert found.value.groups == ("planes",)


@pytest.mark.slow
def test_a_thousand_iterations_write_table_and_plot(tmp_path: Path) -> None:
    long_run(tmp_path, iterations=1000)
    assert (tmp_path / "rows.json").stat().st_size > 0
    assert (tmp_path / "long-run.png").stat().st_size > 0
