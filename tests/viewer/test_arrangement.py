import numpy as np
import pytest

from aa4d.viewer.arrangement import cells, choices, unlike


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 7])
def test_cells_share_the_window_and_overlap_nowhere(count: int) -> None:
    covered = np.zeros((361, 640), int)
    parts = cells(count, 640, 361)
    assert len(parts) == count
    for cell in parts:
        covered[cell.top : cell.top + cell.height, cell.left : cell.left + cell.width] += 1
    assert covered.max() == 1
    assert covered.mean() > 0.7


def test_two_stand_beside_each_other_and_four_in_a_square() -> None:
    assert [(c.left, c.top, c.width, c.height) for c in cells(2, 640, 360)] == [(0, 0, 320, 360), (320, 0, 320, 360)]
    assert [(c.left, c.top) for c in cells(4, 640, 360)] == [(0, 0), (320, 0), (0, 180), (320, 180)]


def test_a_place_belongs_to_one_cell() -> None:
    assert [cell.holds(319.9, 10) for cell in cells(2, 640, 360)] == [True, False]
    assert [cell.holds(320, 10) for cell in cells(2, 640, 360)] == [False, True]


def test_models_of_one_name_can_be_told_apart() -> None:
    assert unlike(["run", "run", "other"]) == ["run", "run (2)", "other"]
    names = [choice.name for choice in choices(["a", "b", "c"])]
    assert names == ["a", "b", "c", "side by side", "a less b", "a less c"]
    assert [choice.name for choice in choices(["a"])] == ["a"]
