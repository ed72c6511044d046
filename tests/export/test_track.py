"""The track file, written from a model and read back by the extension's reader."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from aa4d.errors import InputError
from aa4d.export import export
from aa4d.export.clip import FAINTEST, Clip, WorldGaussians, every_gaussian
from aa4d.filming.camera_path import path_of_frames, with_time
from addon.container import ModelFileError, read_header
from addon.model import read_model
from addon.track import read_track
from tests.export.scenes import riding
from tests.toy_run import silent


@pytest.fixture(scope="module")
def clip(toy_run: Path) -> Clip:
    """Of ten frames, in which a square crosses the picture."""
    loaded = riding(toy_run)
    return Clip(loaded, path_of_frames(loaded, "all"), None)


@pytest.fixture(scope="module")
def path(clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("track")
    export(clip, "track", out, silent)
    return out / "track.safetensors"


def shown(clip: Clip, index: int, ids: np.ndarray) -> WorldGaussians:
    g = every_gaussian(clip.loaded, clip.path.views[index].t, clip.eye_at(index))
    names = ("ids", "means", "quaternions", "scales", "opacities", "colors", "group")
    return WorldGaussians(*(getattr(g, name)[ids] for name in names))


def test_every_number_at_a_key_is_within_the_stated_error(clip: Clip, path: Path) -> None:
    track = read_track(path)
    assert track.times.tolist() == [view.t for view in clip.path.views]
    for index, t in enumerate(track.times):
        g, e = shown(clip, index, track.ids), track.errors
        found = track.at(float(t))
        opacity = np.where(g.opacities >= FAINTEST, g.opacities, 0)
        for name, value, expected in (
            ("position", found.positions, g.means),
            ("log_scale", np.log(found.scales), np.log(g.scales)),
            ("opacity", found.opacities, opacity),
            ("color", found.colors, g.colors),
        ):
            assert np.abs(value - expected).max() <= e[name] + 1e-6, (name, index)
        cosine = np.abs((found.quaternions * g.quaternions).sum(axis=1))
        assert (2 * np.arccos(np.minimum(cosine, 1)) <= 4 * e["rotation"] + 2e-3).all()
    assert track.errors["position"] < 2e-5 * clip.loaded.frame.unit_m
    assert max(track.errors.values()) < 6e-3


def test_what_is_drawn_is_there_and_what_rides_moves_evenly_between_keys(clip: Clip, path: Path) -> None:
    track = read_track(path)
    drawn = {int(i) for index in range(len(clip)) for i in clip.gaussians(index).ids}
    assert set(track.ids.tolist()) == drawn
    assert track.group is not None
    rides = track.group == 0
    assert rides.any()
    assert set(track.group.tolist()) == set(load_file(path)["group"].tolist())
    before, middle, after = (
        track.at(float(t)).positions for t in (track.times[2], track.times[2:4].mean(), track.times[3])
    )
    np.testing.assert_allclose(middle, (before + after) / 2, atol=1e-4)
    np.testing.assert_allclose((after - before)[rides], [[12 / 9, 0, 0]] * rides.sum(), atol=1e-2)
    np.testing.assert_array_equal(track.at(-1.0).positions, track.at(0.0).positions)
    np.testing.assert_array_equal(track.at(2.0).colors, track.at(1.0).colors)


def test_its_header_is_that_of_the_model(clip: Clip, path: Path) -> None:
    track, loaded = read_track(path), clip.loaded
    assert (track.fps, track.background) == (loaded.fps, loaded.background)
    np.testing.assert_array_equal(track.viewmats, [frame.viewmat for frame in loaded.frames])
    assert track.images == tuple(frame.image for frame in loaded.frames)
    assert track.capture is not None
    information = json.loads(read_header(path, ("F32", "U32", "I32", "U16", "U8")).metadata["aa4d"])
    assert information["identity"] == json.loads((path.parent / "export.json").read_text())["identity"]
    assert (path.parent / track.capture).resolve() == loaded.capture_folder
    with pytest.raises(ModelFileError, match="such a file holds F32 alone"):
        read_model(path)


def test_a_clip_of_one_key_holds_at_every_time(clip: Clip, tmp_path: Path) -> None:
    one = replace(clip, path=replace(clip.path, views=clip.path.views[4:5]))
    export(one, "track", tmp_path / "out", silent)
    track = read_track(tmp_path / "out" / "track.safetensors")
    g = shown(one, 0, track.ids)
    for t in (0.0, 1.0):
        np.testing.assert_allclose(track.at(t).positions, g.means, atol=track.errors["position"])


def test_times_that_stand_still_are_refused(clip: Clip, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="times of the views must rise"):
        export(replace(clip, path=with_time(clip.path, 0.5)), "track", tmp_path / "out", silent)


Change = Callable[[dict[str, Any], dict[str, Any]], object]
BAD: dict[str, tuple[Change, str]] = {
    "a model": (lambda info, _: info.update(format="aa4d-model"), "not a track file"),
    "a newer version": (lambda info, _: info.update(version=2), "version 2"),
    "no errors": (lambda info, _: info.pop("errors"), "'errors'"),
    "no times": (lambda info, _: info.update(t=[]), "at least one time"),
    "times that stand still": (lambda info, _: info.update(t=[0.5] * 10), "t must rise"),
    "more times than keys": (lambda info, _: info["t"].append(1.0001), "t must rise"),
    "fewer times than keys": (lambda info, _: info["t"].pop(), "has shape"),
    "a wide camera": (lambda info, _: info["camera"].update(width=10**6), "camera.width"),
    "no ids": (lambda _, tensors: tensors.pop("ids"), "lacks the tensor ids"),
    "ids that are fractions": (lambda _, t: t.update(ids=t["ids"].astype(np.float32)), "lacks the tensor ids"),
    "no keys": (lambda _, tensors: tensors.pop("position.keys"), "lacks the tensor position.keys"),
    "rows that are not there": (lambda _, t: t["position.rows"].__setitem__(-1, 10**9), "must rise and name"),
    "rows twice": (lambda _, t: t["position.rows"].__setitem__(1, t["position.rows"][0]), "must rise and name"),
    "a box turned over": (lambda _, t: t.update({"position.box": t["position.box"][:, ::-1]}), "upper values"),
    "a place that is no number": (lambda _, t: t["position.rest"].__setitem__(0, np.nan), "not finite"),
}


@pytest.mark.parametrize("kind", BAD)
def test_a_damaged_track_file_is_refused_in_one_sentence(kind: str, path: Path, tmp_path: Path) -> None:
    information = json.loads(read_header(path, ("F32", "U32", "I32", "U16", "U8")).metadata["aa4d"])
    tensors = {name: value.copy() for name, value in load_file(path).items()}
    change, words = BAD[kind]
    change(information, tensors)
    bad = tmp_path / "track.safetensors"
    save_file({name: np.ascontiguousarray(v) for name, v in tensors.items()}, bad, {"aa4d": json.dumps(information)})
    with pytest.raises(ModelFileError) as refusal:
        read_track(bad)
    message = str(refusal.value)
    assert words in message
    assert message.endswith(".")
    assert "\n" not in message


def test_every_truncation_is_refused(path: Path, tmp_path: Path) -> None:
    content = path.read_bytes()
    for length in np.linspace(0, len(content) - 1, 40).astype(int):
        (tmp_path / "track.safetensors").write_bytes(content[:length])
        with pytest.raises(ModelFileError):
            read_track(tmp_path / "track.safetensors")


def test_it_says_where_on_earth_and_the_extension_reads_it(
    clip: Clip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    origin = {"latitude_deg": 52.5, "longitude_deg": 13.4, "altitude_m": 34.0}
    monkeypatch.setattr("aa4d.export.origin.geographic_origin", lambda _loaded: origin)
    export(clip, "track", tmp_path / "out", silent)
    path = tmp_path / "out/track.safetensors"
    information = json.loads(read_header(path, ("F32", "U32", "I32", "U16", "U8")).metadata["aa4d"])
    assert information["geographic_origin"] == origin
    assert len(read_track(path).ids) > 0
