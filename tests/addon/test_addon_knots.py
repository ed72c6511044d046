"""Evaluations for a timeline that plays: exact at the knots of time, near enough between them."""

from pathlib import Path

import numpy as np
import pytest
from model_files import make_model, write_model

from addon import carriers, names
from addon.field import Field, prepare
from addon.knots import KEPT, MOST_INTERVALS, Knots, of_clip
from addon.model import read_model

CENTER = np.array([60.0, -30.0, 25.0])


def field_of(folder: Path, **options: object) -> Field:
    return prepare(read_model(write_model(folder / "model.safetensors", *make_model(80, 5, **options))))


def off(field: Field, t: float, knots: Knots, carrier: str) -> float:
    """The largest difference of any attribute, relative to the attribute's range over points."""
    exact, quick = (carriers.evaluate(field, carrier, t, CENTER, names.SHAPE, known) for known in (None, knots))
    return max(float(np.abs(exact[a] - quick[a]).max() / max(np.ptp(exact[a]), 1e-9)) for a in exact)


@pytest.mark.parametrize("carrier", [names.ANCHORS, names.GAUSSIANS])
@pytest.mark.parametrize("aggregation", ["acfa", "anchor_only", "time_only", "mean", "product"])
def test_quick_frames_are_exact_at_knots_and_near_between(tmp_path: Path, carrier: str, aggregation: str) -> None:
    field, knots = field_of(tmp_path, aggregation=aggregation, groups=2), Knots(MOST_INTERVALS)
    for knot in (0, 5, 6, MOST_INTERVALS):
        assert off(field, knot / MOST_INTERVALS, knots, carrier) < 1e-4
    between = [off(field, (knot + 0.5) / MOST_INTERVALS, knots, carrier) for knot in range(MOST_INTERVALS)]
    assert max(between) < 0.05
    if aggregation in ("mean", "product") and carrier == names.ANCHORS:
        assert max(between) < 0.02  # only the scales of DLGD are mixed


def test_few_knots_are_kept_and_none_is_made_twice(tmp_path: Path) -> None:
    field, knots = field_of(tmp_path), Knots(MOST_INTERVALS)
    for t in np.linspace(0, 1, 60):
        carriers.evaluate(field, names.GAUSSIANS, t, CENTER, names.SHAPE, knots)
        assert all(sum(key[0] == name for key in knots.known) <= KEPT for name in ("shares", "offset", "scale"))
    latest = dict(knots.known)
    carriers.evaluate(field, names.GAUSSIANS, 1 - 0.2 / MOST_INTERVALS, CENTER, names.SHAPE, knots)
    assert {key: id(values) for key, values in knots.known.items()} == {key: id(v) for key, v in latest.items()}


def test_static_model_and_one_without_dlgd(tmp_path: Path) -> None:
    for options in ({"stage": "coarse"}, {"dlgd": False}):
        assert off(field_of(tmp_path, **options), 0.4, Knots(MOST_INTERVALS), names.GAUSSIANS) < 0.05


def test_short_clips_have_no_knots() -> None:
    """They would cost more than they save."""
    assert of_clip(12) is None
    assert [of_clip(frames).intervals for frames in (48, 300)] == [8, MOST_INTERVALS]
