"""The precision ladder: what is exact is exact, and each step down costs digits."""

from pathlib import Path

import pytest
import torch

from aa4d.errors import InputError
from aa4d.stress.precision import Row, figure, main, measure, subjects, worst


def test_every_subject_loses_digits_step_by_step() -> None:
    for subject in subjects(anchors=40):
        rows = {(row.arithmetic, row.by): row for row in measure(subject, repeats=1)}
        assert rows["float64", "torch"].gradient_error == 0
        for by in {by for arithmetic, by in rows if arithmetic == "float32"}:
            row = rows["float32", by]
            assert row.value_error is not None
            assert row.gradient_error is not None
            assert max(row.value_error, row.gradient_error) < 1e-4, subject.name
        coarse = rows["bfloat16", "torch"]
        assert coarse.value_error is not None
        assert coarse.gradient_error is not None
        assert max(coarse.value_error, coarse.gradient_error) < 0.3, subject.name
        if "bfloat16" in subject.kernels:
            rounded = rows["bfloat16", "kernel"]
            assert rounded.value_error is not None
            assert 1e-4 < rounded.value_error < 1e-2, subject.name


def test_the_error_is_the_worst_tensor_s_and_none_where_one_is_not_finite() -> None:
    truth = [torch.tensor([3.0, 4.0]).double(), torch.ones(2).double()]
    assert worst([torch.tensor([3.0, 4.5]), torch.ones(2)], truth) == pytest.approx(0.1)
    assert worst([torch.tensor([3.0, torch.nan]), torch.ones(2)], truth) is None


def test_the_plot_shows_what_is_finite() -> None:
    rows = [Row("a", "float64", "torch", 0.0, 0.0, 9.0), Row("a", "float32", "kernel", 1e-7, 1e-6, 1.0)]
    axes = figure([*rows, Row("a", "bfloat16", "torch", None, None, 3.0)]).axes[0]
    drawn = [line.get_xydata().tolist() for line in axes.lines if len(line.get_xydata())]
    assert drawn == [[[1.0, 1e-6]], [[1.0, 1e-6]]]


@pytest.mark.parametrize(("options", "said"), [({"repeats": 0}, "--repeats 0"), ({"json": Path("/no/x")}, "/no")])
def test_bad_options_are_one_sentence(options: dict, said: str) -> None:
    with pytest.raises(InputError, match=said):
        main(**options)
