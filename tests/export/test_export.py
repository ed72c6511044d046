"""Exports are continued, refused and described whatever the format."""

import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from plyfile import PlyData

from aa4d.errors import InputError
from aa4d.export import EXPORTERS, export, what_to_open
from aa4d.export.clip import (
    Clip,
)
from aa4d.export.origin import geographic_origin
from aa4d.filming.camera_path import path_of_frames
from aa4d.methods.model_file import load_model
from tests.toy_run import silent


@pytest.mark.parametrize("name", ["ply", "points"])
def test_a_stopped_export_continues(clip: Clip, tmp_path: Path, name: str) -> None:
    out, prefix = tmp_path / "out", "clip_" if name == "ply" else ""

    def stop(_done: int, _total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export(clip, name, out, stop)
    assert sorted(p.name for p in out.iterdir()) == [f"{prefix}000000.ply", "export.json"]
    kept = (out / f"{prefix}000000.ply").stat().st_mtime_ns
    export(clip, name, out, silent)
    assert (out / f"{prefix}000000.ply").stat().st_mtime_ns == kept
    assert sorted(p.name for p in out.iterdir()) == [f"{prefix}000000.ply", f"{prefix}000008.ply", "export.json"]
    settings = json.loads((out / "export.json").read_text())
    assert settings["exporter"] == name
    assert settings["identity"]["made_from"] == {"model": clip.loaded.identity.digest()}
    *others, comment = PlyData.read(str(out / f"{prefix}000008.ply")).comments
    assert others == (["SplatRenderMode: default"] if name == "ply" else [])
    assert json.loads(comment.removeprefix("aa4d ")) == settings["identity"]
    of_old = {key: value for key, value in settings.items() if key != "identity"}
    (out / "export.json").write_text(json.dumps(of_old))
    export(clip, name, out, silent)
    (out / "export.json").write_text(json.dumps(of_old | {"model_sha256": "0"}))
    with pytest.raises(InputError, match="holds an export with other settings"):
        export(clip, name, out, silent)
    assert [v["t"] for v in settings["views"]] == [v.t for v in clip.path.views]


def test_where_on_earth_it_is_goes_along_while_the_capture_knows(toy_run: Path, tmp_path: Path) -> None:
    origin = {"latitude_deg": 52.5, "longitude_deg": 13.4, "altitude_m": 34.0}
    capture = tmp_path / "capture"
    capture.mkdir()
    loaded = replace(load_model(toy_run / "model.safetensors"), capture_folder=capture)
    for world, expected in ((origin, origin), (origin | {"altitude_m": "high"}, None), (None, None)):
        (capture / "capture.json").write_text(json.dumps({"generator": {"world": {"origin": world}}}))
        assert geographic_origin(loaded) == expected
    (capture / "capture.json").write_text(json.dumps({"generator": {"world": {"origin": origin}}}))
    clip = Clip(loaded, path_of_frames(loaded, "held-out"), None)
    export(clip, "ply", tmp_path / "ply", silent)
    comments = PlyData.read(str(tmp_path / "ply/clip_000000.ply")).comments
    assert json.loads(comments[1].removeprefix("geographic origin ")) == origin
    (capture / "capture.json").unlink()
    assert geographic_origin(loaded) is None
    export(clip, "ply", tmp_path / "ply", silent)  # goes on all the same


@pytest.mark.parametrize(("name", "opens"), [("html", "scene.html"), ("track", "track.safetensors"), ("points", "")])
def test_what_is_said_to_be_opened_is_the_file_where_there_is_one(
    clip: Clip, tmp_path: Path, name: str, opens: str
) -> None:
    out = tmp_path / "out"
    export(clip, name, out, silent)
    assert what_to_open(out) == out / opens
    assert what_to_open(out).exists()


def test_another_export_or_folder_is_not_written_into(clip: Clip, tmp_path: Path) -> None:
    export(clip, "points", tmp_path / "out", silent)
    with pytest.raises(InputError, match="holds an export with other settings"):
        export(clip, "ply", tmp_path / "out", silent)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/notes").touch()
    with pytest.raises(InputError, match="not empty and not an export"):
        export(clip, "ply", tmp_path / "mine", silent)


@pytest.mark.parametrize("name", [name for name, exporter in EXPORTERS.items() if exporter.states_axes])
def test_a_format_that_states_its_axes_has_no_choice(clip: Clip, tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="states its axes"):
        export(replace(clip, axes="viewer"), name, tmp_path / "out", silent)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("name", "module"), [("4dgs", "fourdgs"), ("usd", "pxr"), ("usd-points", "pxr")])
def test_a_missing_package_is_named(
    clip: Clip, tmp_path: Path, name: str, module: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputError, match=f"--format {name}: needs the package"):
        export(clip, name, tmp_path / "out", silent)
    assert not (tmp_path / "out").exists()


def test_the_model_file_alone_is_enough(toy_run: Path, tmp_path: Path) -> None:
    alone = tmp_path / "model.safetensors"
    shutil.copyfile(toy_run / "model.safetensors", alone)
    loaded = load_model(alone)
    assert loaded.capture_folder is not None
    assert not loaded.capture_folder.exists()
    export(Clip(loaded, path_of_frames(loaded, "held-out"), None), "points", tmp_path / "out", silent)
    assert (tmp_path / "out/000008.ply").exists()
