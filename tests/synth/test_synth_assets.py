"""Models of the user's own instead of the built-in meshes."""

import importlib.util
import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from synth.camera import pixel_centres, unproject
from synth.errors import InputError
from synth.models import find_models
from synth.spec import Asset

BOX = """\
v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nv -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1
f 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\nf 5 6 7 8\nf 4 3 2 1
"""
Command = Callable[[Sequence[object]], "object"]


@pytest.mark.parametrize(
    ("file", "words"),
    [("../car.obj", "folder"), ("car.blend", "must end in"), ("absent.glb", "cannot read it")],
)
def test_bad_files_are_refused(tmp_path: Path, file: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        find_models([Asset(kind="saloon", file=file)], tmp_path)


def test_a_kind_given_twice_is_refused(tmp_path: Path) -> None:
    (tmp_path / "car.obj").write_text(BOX)
    with pytest.raises(InputError, match="twice"):
        find_models([Asset(kind="saloon", file="car.obj")] * 2, tmp_path)


@pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs the bpy module")
def test_a_model_stands_where_its_vehicle_is_and_fits_its_box(
    flyover: Command, tiny_scene: Path, tmp_path: Path
) -> None:
    """A box, two high (y is up in OBJ files) and one wide: seen with the id of the vehicle, scaled to its height."""
    (tmp_path / "car.obj").write_text(BOX)
    text = tiny_scene.read_text().replace("frames = 6", "frames = 1")
    (tmp_path / "scene.toml").write_text(text + '\n[[assets]]\nkind = "saloon"\nfile = "car.obj"\n')
    result = flyover([tmp_path / "scene.toml", "--out", tmp_path / "out"])
    assert result.returncode == 0, result.stderr  # type: ignore[attr-defined]
    index = json.loads((tmp_path / "out" / "capture.json").read_text())
    truth = np.load(tmp_path / "out" / index["frames"][0]["truth"])
    tracks = np.load(tmp_path / "out" / "truth" / "tracks.npz")
    instance = index["instances"][0]
    assert "saloon" in instance["name"]
    seen = truth["instance_id"] == instance["id"]
    assert seen.sum() > 5
    points = unproject(pixel_centres(96, 54), truth["depth_z"].astype(float), np.array(index["frames"][0]["viewmat"]),
                       np.array(index["camera"]["K"]))[seen]  # fmt: skip
    pose = tracks["object_to_world"][0, 0]
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    height = instance["dimensions_m"][2]
    assert local[:, 2].max() == pytest.approx(height, abs=0.02)
    assert np.abs(local[:, 0]).max() < height / 2 + 0.03
    assert np.abs(local[:, 1]).max() < height / 4 + 0.03


CARS = Path(__file__).resolve().parents[3] / "shared" / "data" / "assets_quaternius" / "vehicles_fbx"


@pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs the bpy module")
@pytest.mark.skipif(not CARS.is_dir(), reason="needs ../shared/data/assets_quaternius")
def test_a_model_whose_file_says_that_it_is_transparent_is_seen(
    flyover: Command, tiny_scene: Path, tmp_path: Path
) -> None:
    """This FBX comes in with an alpha of 0: its ids added up through its layers, and nobody saw it."""
    (tmp_path / "car.fbx").write_bytes((CARS / "Taxi.fbx").read_bytes())
    text = tiny_scene.read_text().replace("frames = 6", "frames = 1")
    table = '\n[[assets]]\nkind = "saloon"\nfile = "car.fbx"\n'
    (tmp_path / "askew.toml").write_text(text + table)
    refused = flyover([tmp_path / "askew.toml", "--out", tmp_path / "out"])
    assert refused.returncode == 2  # type: ignore[attr-defined]
    assert "times as wide as long" in refused.stderr  # type: ignore[attr-defined]
    (tmp_path / "scene.toml").write_text(text + table + "yaw_deg = 90\n")
    result = flyover([tmp_path / "scene.toml", "--out", tmp_path / "out"])  # nothing was rendered there yet
    assert result.returncode == 0, result.stderr  # type: ignore[attr-defined]
    index = json.loads((tmp_path / "out" / "capture.json").read_text())
    ids = np.load(tmp_path / "out" / index["frames"][0]["truth"])["instance_id"]
    assert ids.max() <= len(index["instances"])
    saloons = [i["id"] for i in index["instances"] if "saloon" in i["name"]]
    assert np.isin(ids, saloons).sum() > 5


@pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs the bpy module")
def test_a_damaged_model_is_one_sentence(flyover: Command, tiny_scene: Path, tmp_path: Path) -> None:
    (tmp_path / "car.glb").write_bytes(b"glTF" + bytes(40))
    (tmp_path / "scene.toml").write_text(tiny_scene.read_text() + '\n[[assets]]\nkind = "saloon"\nfile = "car.glb"\n')
    result = flyover([tmp_path / "scene.toml", "--out", tmp_path / "out"])
    assert result.returncode == 2  # type: ignore[attr-defined]
    assert "Blender cannot import it" in result.stderr  # type: ignore[attr-defined]
    assert len(result.stderr.strip().splitlines()) == 1  # type: ignore[attr-defined]
