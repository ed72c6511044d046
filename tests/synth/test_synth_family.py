"""The controlled family: one knob each, all else equal."""

from pathlib import Path

import numpy as np
import pytest

from synth.family import DURATION_S, WAY_M, members, travelled
from synth.plan import make_plan
from synth.spec import read_scene
from synth.truth.activity import active_share, changes_per_second

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "scenes/heterogeneity/controlled"


def test_the_files_are_what_the_program_writes() -> None:
    there = {path.name: path.read_text() for path in FOLDER.iterdir()}
    written = {f"{m.name}.toml": m.scene for m in members()} | {f"{m.name}.csv": m.table() for m in members()}
    assert there == written, "run `python -m synth.family scenes/heterogeneity/controlled`"


@pytest.mark.parametrize("changes", [1, 2, 3])
def test_two_go_at_every_instant_and_all_go_as_far(changes: int) -> None:
    times = np.linspace(0, DURATION_S, 2001)
    first, second = (travelled(times, changes, second=later) for later in (False, True))
    for way in (first, second):
        assert way[0] == 0
        assert way[-1] == pytest.approx(WAY_M)
        assert (np.diff(way) >= 0).all()
    goes = [np.diff(way) > 1e-9 for way in (first, second)]
    assert ((goes[0] ^ goes[1]).mean()) > 0.99
    acceleration = np.diff(first, 2) / (times[1] - times[0]) ** 2
    assert np.abs(acceleration).max() < 9, "nobody could drive so"
    assert (np.diff(goes[0].astype(int)) != 0).sum() == 2 * changes - 1


def test_cars_keep_apart_and_move_the_same_in_every_scene() -> None:
    ways = []
    for path in (FOLDER / "lanes1-changes3.toml", FOLDER / "lanes4-changes1.toml"):
        plan = make_plan(read_scene(path), FOLDER)  # refuses bodies that touch
        poses = np.stack([plan.fleet.object_to_world(t) for t in np.linspace(0, DURATION_S, 200)])[..., :2, 3]
        way = np.linalg.norm(np.diff(poses, axis=0), axis=2).sum(axis=0)
        ways.append(way[way > 0])
    assert np.allclose(ways, np.full((2, 4), WAY_M), atol=0.05)


def test_how_much_is_active_and_how_often_that_changes() -> None:
    active = np.zeros((5, 4), bool)
    active[:, 0] = [True, False, True, True, False]
    active[1:, 1] = True
    assert active_share(active) == 0.5
    assert changes_per_second(active, 2.0) == pytest.approx((3 + 1) / 2 / 2.0)
    assert active_share(np.zeros((3, 0), bool)) == changes_per_second(np.zeros((3, 2), bool), 1.0) == 0.0
    assert changes_per_second(active[:1], 0.0) == 0.0
