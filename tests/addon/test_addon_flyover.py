"""The script that makes flyover.blend, run as the demo runs it."""

import shutil
import subprocess
import sys
from argparse import Namespace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from model_files import make_model, write_model
from PIL import Image

SCRIPT = Path(__file__).resolve().parent.parent.parent / "addon" / "make_flyover_blend.py"


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(SCRIPT), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


@pytest.mark.parametrize("gaussians", [False, True])
def test_makes_a_blend_and_a_picture(gaussians: bool, extension: str, extension_zip: Path, tmp_path: Path) -> None:
    import bpy

    assert extension  # installed here, to look into the file
    model = write_model(tmp_path / "model.safetensors", *make_model(300))
    blend, picture = tmp_path / "flyover.blend", tmp_path / "frame.png"
    done = run(
        model,
        "--extension",
        extension_zip,
        "--out",
        blend,
        "--render",
        picture,
        "--frame",
        2,
        *["--gaussians"] * gaussians,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [f"Saved {blend}", f"Rendered {picture}"]
    assert blend.read_bytes()[:4] in (b"BLEN", b"\x28\xb5\x2f\xfd")  # plain, or compressed by zstd
    with Image.open(picture) as image:
        assert image.size == (640, 360)
        pixels = np.asarray(image.convert("RGB"))
    background = np.round(255 * np.array([0.1, 0.2, 0.3]))
    covered = (np.abs(pixels - background) > 8).any(axis=2).mean()
    assert 0.05 < covered < 0.95
    assert not list(tmp_path.glob(".*"))
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    scene = bpy.context.scene
    assert (scene.frame_start, scene.frame_end, scene.frame_current) == (1, 5, 2)
    assert scene.camera.type == "CAMERA"
    shown = [obj for obj in bpy.data.objects if obj.type == "MESH" and not obj.hide_viewport]
    assert [obj.aa4d.carrier for obj in shown] == ["ANCHORS"]
    rendered = [obj for obj in bpy.data.objects if obj.type == "MESH" and not obj.hide_render]
    assert [obj.aa4d.carrier for obj in rendered] == ["GAUSSIANS" if gaussians else "ANCHORS"]
    obj = shown[0]
    assert obj.aa4d.filepath == "//model.safetensors"
    places = []
    for frame in (1, 5):
        scene.frame_set(frame)
        geometry = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).evaluated_geometry()
        cloud = geometry.pointcloud
        place = np.empty(3 * len(cloud.points), np.float32)
        cloud.attributes["position"].data.foreach_get("vector", place)
        places.append(np.median(place.reshape(-1, 3), axis=0))
    assert np.linalg.norm(places[1] - places[0]) > 0.1


@pytest.mark.parametrize(("frame", "words"), [(None, "cut short"), (99, "--frame 99 is outside the clip, 1 to 5")])
def test_bad_input_is_one_line_and_leaves_nothing(
    frame: int | None, words: str, extension_zip: Path, tmp_path: Path
) -> None:
    model = write_model(tmp_path / "model.safetensors", *make_model(20))
    if frame is None:
        model.write_bytes(model.read_bytes()[:-50])
    options = [] if frame is None else ["--frame", frame]
    done = run(model, "--extension", extension_zip, "--out", tmp_path / "flyover.blend", *options)
    assert done.returncode == 2
    assert words in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == [model]


def test_foreign_extension_is_refused_in_one_line(tmp_path: Path) -> None:
    pytest.importorskip("bpy")
    model = write_model(tmp_path / "model.safetensors", *make_model(20))
    done = run(model, "--extension", model, "--out", tmp_path / "flyover.blend")
    assert done.returncode == 2
    assert done.stderr.strip() == f"{model} is not the extension; build it with addon/build_extension.py."
    assert list(tmp_path.iterdir()) == [model]


def test_vehicles_are_objects_of_the_blend(extension: str, extension_zip: Path, tmp_path: Path) -> None:
    import bpy

    assert extension
    model = write_model(tmp_path / "model.safetensors", *make_model(120, groups=3))
    blend = tmp_path / "flyover.blend"
    options = ["--gaussians", "--car", -4, 2.5, 12, 2.5]
    done = run(model, "--extension", extension_zip, "--out", blend, *options)
    assert done.returncode == 0, done.stderr
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    meshes = [obj for obj in bpy.data.objects if obj.type == "MESH" and obj.aa4d.filepath]
    assert {obj.aa4d.playback for obj in meshes} == {"BAKED"}
    assert {obj.aa4d.filepath for obj in meshes} == {"//model.safetensors"}
    shown = [obj for obj in meshes if not obj.hide_viewport]
    assert {obj.aa4d.carrier for obj in shown} == {"ANCHORS"}
    assert {"car 1", "car 2", "car 3"} < {obj.name for obj in shown}
    rendered = [obj for obj in meshes if not obj.hide_render]
    assert {obj.aa4d.carrier for obj in rendered} == {"GAUSSIANS"}
    assert len(rendered) == len(shown) == 4


def test_drives_a_car_through_the_scene(extension: str, extension_zip: Path, tmp_path: Path) -> None:
    import bpy

    assert extension
    model = write_model(tmp_path / "model.safetensors", *make_model(300))
    blend = tmp_path / "flyover.blend"
    done = run(model, "--extension", extension_zip, "--out", blend, "--car", -4, 2.5, 12, 2.5)
    assert done.returncode == 0, done.stderr
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    scene, car = bpy.context.scene, bpy.data.objects["CG Car"]
    for frame, x in ((1, -4), (3, 4), (5, 12)):
        scene.frame_set(frame)
        np.testing.assert_allclose(car.matrix_world.translation[:2], (x, 2.5), atol=1e-4)
    assert len(car.children) == 6
    assert [obj.name for obj in scene.objects if obj.type == "LIGHT"] == ["AdaAnchor4D Sun"]
    points = next(obj for obj in bpy.data.objects if obj.type == "MESH" and obj.aa4d.filepath)
    assert points.visible_shadow
    assert not points.is_holdout


def test_a_full_disk_for_scratch_files_is_told_before_blender_begins(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Blender would install the extension without a word, and then not know it."""
    from addon.make_flyover_blend import make

    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=800_000))
    with pytest.raises(OSError, match=r"less than 16 MiB are free.*TMPDIR"):
        make(Namespace(), str(tmp_path))


def test_a_file_that_blender_could_not_write_whole_is_told_and_the_one_before_stays(tmp_path: Path) -> None:
    from addon.make_flyover_blend import IEND, whole

    path = tmp_path / "frame.png"
    for content in (b"whole" + IEND, b"another" + IEND):
        with whole(path, IEND) as partial:
            partial.write_bytes(content)
        assert path.read_bytes() == content
    with pytest.raises(OSError, match="could not be written whole; free some space"), whole(path, IEND) as partial:
        partial.write_bytes(b"half")
    assert [p.name for p in tmp_path.iterdir()] == ["frame.png"]
    assert path.read_bytes() == content
