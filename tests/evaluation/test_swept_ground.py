"""Ground that something drives over at another time: by place, by height, and its score."""

from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from PIL import Image

from aa4d.capture.reader import read_capture, read_image
from aa4d.errors import InputError
from aa4d.evaluation.evaluate import evaluate
from aa4d.evaluation.image_metrics import psnr
from aa4d.evaluation.swept_ground import SweptGround
from aa4d.training.trainer import train
from tests.evaluation.test_activity_share import FRAMES, ORIGIN, SIDE, write_activity
from tests.toy_capture import ALTITUDE_M, FOCAL, HEIGHT, WIDTH, square_centre
from tests.toy_run import BRIEF, silent

ROWS, COLUMNS = 10, 16


def footprints() -> NDArray[np.bool_]:
    """[N, R, C] cells that the toy's square touches."""
    x = ORIGIN[0] + (np.arange(COLUMNS) + 0.5) * SIDE
    y = ORIGIN[1] + (np.arange(ROWS) + 0.5) * SIDE
    centers = np.array([square_centre(i / (FRAMES - 1)) for i in range(FRAMES)])
    over = [np.abs(c - along) < 1.5 + SIDE / 2 for c, along in ((centers[:, :1], x), (centers[:, 1:], y))]
    return over[1][:, :, None] & over[0][:, None, :]


def write_footprints(capture: Path) -> NDArray[np.bool_]:
    active = footprints()
    write_activity(capture, active, active.any(axis=0).astype(np.uint8))
    return active


def cells_of(index: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Row and column [H, W] of the cell that each pixel of a frame shows: nadir cameras over a plane."""
    columns, rows = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    x = -2 + 4 * index / (FRAMES - 1) + (columns - WIDTH / 2) / FOCAL * ALTITUDE_M
    y = -(rows - HEIGHT / 2) / FOCAL * ALTITUDE_M
    return np.floor((y - ORIGIN[1]) / SIDE).astype(int), np.floor((x - ORIGIN[0]) / SIDE).astype(int)


def test_swept_is_where_something_moves_at_another_time_and_not_now(toy_capture: Path) -> None:
    active = write_footprints(toy_capture)
    ground = SweptGround(read_capture(toy_capture))
    for index in (0, 4, 9):
        row, column = cells_of(index)
        swept = ground.of_frame(index)
        assert swept is not None
        assert np.array_equal(swept, active.any(axis=0)[row, column] & ~active[index, row, column])
        assert 0.05 < swept.mean() < 0.5


def test_what_stands_over_the_way_is_not_ground(toy_capture: Path) -> None:
    """The crown of a tree five meters up, and a kerb."""
    write_footprints(toy_capture)
    path = toy_capture / "truth/000004.npz"
    truth = dict(np.load(path))
    flat = SweptGround(read_capture(toy_capture)).of_frame(4)
    assert flat is not None
    v, u = np.argwhere(flat)[flat.sum() // 2]
    for height_m, counts in ((5.0, False), (0.1, True)):
        depth = truth["depth_z"].copy()
        depth[v, u] -= height_m
        np.savez(path, **(truth | {"depth_z": depth}))
        swept = SweptGround(read_capture(toy_capture)).of_frame(4)
        assert swept is not None
        assert swept[v, u] == counts


def test_without_truth_of_activity_there_is_none(toy_capture: Path) -> None:
    assert SweptGround(read_capture(toy_capture)).of_frame(0) is None


def test_cells_of_other_frames_are_refused(toy_capture: Path) -> None:
    active = footprints()[1:]
    write_activity(toy_capture, active, active.any(axis=0).astype(np.uint8))
    with pytest.raises(InputError, match=r"activity\.npz: its arrays do not fit together, or the capture"):
        SweptGround(read_capture(toy_capture))


def test_its_score_is_that_of_these_pixels_over_all_held_out_frames(toy_capture: Path, tmp_path: Path) -> None:
    write_footprints(toy_capture)
    capture, run = read_capture(toy_capture), tmp_path / "run"
    train(capture, run, BRIEF, silent)
    metrics = evaluate(run, toy_capture, silent)
    ground, found, truth = SweptGround(capture), [], []
    for index in capture.of_split("test"):
        swept = ground.of_frame(index)
        assert swept is not None
        picture = np.array(Image.open(run / f"eval/{capture.frames[index].name}.png"))
        found.append(torch.from_numpy(picture[swept]).double() / 255)
        truth.append(torch.from_numpy(read_image(capture, capture.frames[index])[swept]).double() / 255)
    assert metrics.psnr_swept == pytest.approx(psnr(torch.cat(found), torch.cat(truth)), abs=1e-6)
