import gc
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from aa4d.errors import InputError
from aa4d.motion.tracks import ALWAYS, Tracks
from aa4d.motion.tracks_file import load_tracks, save_tracks


def tracks(groups: int) -> Tracks:
    generator = np.random.default_rng(0)
    labels = generator.integers(0, groups + 1, (3, 5, 11)).astype(np.uint16)
    return Tracks(
        tuple(f"mover {g}" for g in range(groups)),
        generator.normal(size=(groups, 6, 4)),
        np.tile(np.array(ALWAYS), (groups, 1)),
        np.array([0.0, 0, 1]),
        labels,
        (labels > 0) | (generator.random(labels.shape) > 0.5),
    )


@pytest.mark.parametrize("groups", [0, 1, 300])
def test_tracks_survive_their_file(tmp_path: Path, groups: int) -> None:
    before = tracks(groups)
    save_tracks(tmp_path / "tracks.npz", before)
    after = load_tracks(tmp_path / "tracks.npz")
    assert after.names == before.names
    for name in ("control", "shown", "up", "labels", "moving"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))


def test_a_file_that_cannot_be_finished_is_one_error_and_nothing_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    resource = pytest.importorskip("resource")  # Windows has none
    said: list[object] = []
    monkeypatch.setattr(sys, "unraisablehook", said.append)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, limits[1]))
    try:
        with pytest.raises(OSError, match=r"tracks\.npz"):
            save_tracks(tmp_path / "tracks.npz", tracks(300))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    gc.collect()
    assert said == []
    assert list(tmp_path.iterdir()) == []


def change(path: Path, **changes: object) -> None:
    with np.load(path) as file:
        arrays = dict(file)
    np.savez(path, **{name: value for name, value in (arrays | changes).items() if value is not None})


@pytest.mark.parametrize(
    "changes",
    [
        {"control": np.full((2, 6, 4), np.nan)},
        {"control": np.zeros((2, 3, 4))},
        {"control": np.zeros((3, 6, 4))},
        {"control": np.zeros(7)},
        {"shown": None},
        {"labels": np.full((3, 5, 11), 3, np.uint16)},
        {"moving": np.zeros((3, 4), np.uint8)},
        {"names": np.array(["a"])},
    ],
)
def test_tracks_that_do_not_fit_together_are_refused(tmp_path: Path, changes: dict[str, object]) -> None:
    path = tmp_path / "tracks.npz"
    save_tracks(path, tracks(2))
    change(path, **changes)
    with pytest.raises(InputError, match=re.escape("delete the run and train again")):
        load_tracks(path)


def test_a_damaged_file_of_tracks_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "tracks.npz"
    save_tracks(path, tracks(2))
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(InputError, match=r"tracks.npz: tracks cannot be read"):
        load_tracks(path)
