"""Weights on spatio-temporal planes against true activity, in closed form."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from aa4d.capture.reader import Capture, read_capture
from aa4d.errors import InputError
from aa4d.evaluation.activity_share import rank_correlation, true_activity
from aa4d.evaluation.ground_cells import ACTIVITY, ground_cells
from aa4d.methods.model_file import LoadedModel, load_model

FRAMES, SIDE, ORIGIN = 10, 2.0, (-16.0, -10.0)


def write_activity(capture: Path, active: np.ndarray, labels: np.ndarray | None = None) -> None:
    """Cells of two meters around the toy's plane."""
    rows, columns = active.shape[1:]
    labels = np.zeros((rows, columns), np.uint8) if labels is None else labels
    np.savez(
        capture / ACTIVITY, cell_active=active, cell_label=labels, origin_m=np.array(ORIGIN), cell_m=np.array(SIDE)
    )


@pytest.fixture
def pair(toy_run: Path, toy_capture: Path) -> tuple[LoadedModel, Capture]:
    return load_model(toy_run / "model.safetensors"), read_capture(toy_capture)


def test_activity_of_a_place_is_that_of_its_cell(toy_capture: Path) -> None:
    active = np.zeros((FRAMES, 10, 16), bool)
    active[:4, 2, 3] = True
    labels = np.zeros((10, 16), np.uint8)
    labels[5, 5] = 4
    write_activity(toy_capture, active, labels)
    in_cell = np.array([[-16 + 3.5 * 2, -10 + 2.1 * 2, 0.3], [-16 + 3.5 * 2, -10 + 3.1 * 2, 0.0]])
    outside = np.array([[-16.1, 0.0, 0.0], [16.5, 0, 0], [-16 + 5.5 * 2, -10 + 5.5 * 2, 0]])
    cells = ground_cells(read_capture(toy_capture))
    assert cells is not None
    found = true_activity(cells, np.concatenate([in_cell, outside]))
    assert found[:2].tolist() == [0.4, 0.0]
    assert np.isnan(found[2:]).all(), "beyond the cells, and over one that no frame sees"


def test_weights_that_follow_activity_correlate_and_those_against_it_do_the_opposite(
    pair: tuple[LoadedModel, Capture], monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded, capture = pair
    active = np.zeros((FRAMES, 10, 16), bool)
    for column in range(16):
        active[: column * FRAMES // 16, :, column] = True  # more to the east
    write_activity(capture.folder, active)
    matrix = loaded.frame.matrix()
    east = torch.from_numpy(loaded.model.resting(None).double().numpy() @ matrix[:3, :3].T + matrix[:3, 3])[:, 0]
    for sign in (1, -1):
        share = torch.sigmoid(sign * east / 10)
        weights = torch.stack([(1 - share) / 3] * 3 + [share / 3] * 3, dim=1).float()
        monkeypatch.setattr(type(loaded.model), "plane_weights", lambda self, t, w=weights: w)  # noqa: ARG005
        found = rank_correlation(loaded, capture)
        assert found is not None
        assert sign * found > 0.95


def test_nothing_to_measure_by_is_none(pair: tuple[LoadedModel, Capture]) -> None:
    loaded, capture = pair
    assert rank_correlation(loaded, capture) is None, "no truth of activity"
    write_activity(capture.folder, np.zeros((FRAMES, 10, 16), bool))
    assert rank_correlation(loaded, capture) is None, "nothing is active"
    write_activity(capture.folder, np.random.default_rng(0).random((FRAMES, 10, 16)) < 0.5)
    assert rank_correlation(loaded, capture) is not None
    assert rank_correlation(replace(loaded, is_static=True), capture) is None


def test_truth_that_does_not_fit_together_is_refused(pair: tuple[LoadedModel, Capture]) -> None:
    write_activity(pair[1].folder, np.zeros((FRAMES, 10, 16), bool), np.zeros((9, 16), np.uint8))
    with pytest.raises(InputError, match=r"activity\.npz: its arrays do not fit together"):
        rank_correlation(*pair)
