"""Files that the packaged extension reads or belongs to: changed, moved, appended, linked, or beside the model."""

import importlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driving import attribute, drawn, go_to, imported
from model_files import make_model, write_model
from PIL import Image

FRAMES = 5


def test_changed_file_is_said_and_relinked(bpy: Any, model_path: Path, tmp_path: Path, capfd: Any) -> None:
    obj = imported(bpy, model_path)
    obj.data.vertices.foreach_set("select", np.arange(60) < 20)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.delete(type="VERT")
    bpy.ops.object.mode_set(mode="OBJECT")
    go_to(bpy, 2)
    before = attribute(obj.data, "position")
    write_model(model_path, *make_model(60, FRAMES, seed=4))
    capfd.readouterr()
    go_to(bpy, 3)
    go_to(bpy, 4)
    assert "".join(capfd.readouterr()).count("is no longer the file that") == 1
    np.testing.assert_array_equal(attribute(obj.data, "position"), before)
    assert bpy.ops.aa4d.relink(filepath=str(model_path)) == {"FINISHED"}
    other = imported(bpy, model_path)
    go_to(bpy, 3)
    np.testing.assert_array_equal(attribute(obj.data, "position"), attribute(other.data, "position")[20:])
    bpy.context.view_layer.objects.active = obj
    small = write_model(tmp_path / "small.safetensors", *make_model(10, FRAMES))
    with pytest.raises(RuntimeError, match="fewer points"):
        bpy.ops.aa4d.relink(filepath=str(small))
    assert obj.aa4d.last_place == str(model_path)


def test_file_saved_elsewhere_and_appended_finds_its_model(bpy: Any, model_path: Path, tmp_path: Path) -> None:
    obj = imported(bpy, model_path)  # unsaved: the path is absolute
    name = obj.name
    assert obj.aa4d.filepath == str(model_path)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "work.blend"))
    assert bpy.context.active_object.aa4d.filepath == "//crossing/model.safetensors"
    (tmp_path / "deep" / "down").mkdir(parents=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "deep" / "down" / "work.blend"))
    assert bpy.data.objects[name].aa4d.filepath == "//../../crossing/model.safetensors"
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "work.blend"), link=False) as (_, into):
        into.objects = [name]
    appended = bpy.data.objects[name]
    bpy.context.scene.collection.objects.link(appended)
    go_to(bpy, 2)
    at_two = attribute(appended.data, "position")
    go_to(bpy, 4)
    assert np.abs(attribute(appended.data, "position") - at_two).max() > 0.1


def test_linked_bake_plays(bpy: Any, model_path: Path, tmp_path: Path) -> None:
    obj = imported(bpy, model_path, bake=True)
    name = obj.name
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "work.blend"))
    model_path.unlink()
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "work.blend"), link=True) as (_, into):
        into.objects = [name]
    linked = bpy.data.objects[name]
    bpy.context.scene.collection.objects.link(linked)
    places = []
    for frame in (2, 4):
        go_to(bpy, frame)
        places.append(drawn(bpy, linked)["position"])
    assert np.abs(places[0] - places[1]).max() > 0.1
    linked.select_set(True)
    bpy.context.view_layer.objects.active = linked
    operators = bpy.ops.aa4d
    changing = (operators.bake, operators.free_bake, operators.relink, operators.fit_legend, operators.label_activity)
    assert not any(operator.poll() for operator in (*changing, operators.set_up_compositing))
    assert operators.export_ply.poll()


def test_footage_stands_behind_the_camera_in_step(bpy: Any, tmp_path: Path) -> None:
    capture = tmp_path / "capture"
    (capture / "frames").mkdir(parents=True)
    (capture / "capture.json").write_text(json.dumps({"format": "aa4d-capture"}))
    for rank in range(FRAMES):
        Image.new("RGB", (32, 18), (10 + 40 * rank, 0, 0)).save(capture / "frames" / f"{rank:06}.png")
    tensors, information = make_model(20, FRAMES)
    information["capture"] = "../capture"
    (tmp_path / "run").mkdir()
    path = write_model(tmp_path / "run" / "model.safetensors", tensors, information)
    imported(bpy, path)
    camera = next(o for o in bpy.data.objects if o.type == "CAMERA")
    background = camera.data.background_images[0]
    assert camera.data.show_background_images
    assert background.image.source == "SEQUENCE"
    assert Path(bpy.path.abspath(background.image.filepath)).name == "000000.png"
    user = background.image_user  # Blender shows the file number frame - start + 1 + offset
    assert (user.frame_start, user.frame_duration, user.frame_offset) == (1, FRAMES, -1)
    information["capture"] = "../nowhere"
    imported(bpy, write_model(path.parent / "other.safetensors", tensors, information))
    assert [len(o.data.background_images) for o in bpy.data.objects if o.type == "CAMERA"].count(0) == 1


def test_more_points_than_allowed_are_refused(bpy: Any, model_path: Path) -> None:
    with pytest.raises(RuntimeError, match="180 gaussians, more than the 100 allowed"):
        bpy.ops.aa4d.import_model(filepath=str(model_path), carrier="GAUSSIANS", largest=100)
    assert not bpy.data.objects
    assert not bpy.data.meshes


@pytest.mark.parametrize(
    "image",
    [
        "frames/\0.png",
        "frames/{}.png".format("1" * 5000),
        "frames/999999999999.png",
        "a" * 300 + "1.png",
        "\udcff1.png",
    ],
)
def test_image_name_that_none_can_have_leaves_the_footage_out(bpy: Any, tmp_path: Path, image: str, capfd: Any) -> None:
    capture = tmp_path / "capture"
    (capture / "frames").mkdir(parents=True)
    (capture / "capture.json").write_text(json.dumps({"format": "aa4d-capture"}))
    tensors, information = make_model(20, 1)
    information["capture"], information["frames"][0]["image"] = "capture", image
    for place in ("frames/999999999999.png", "\udcff1.png"):
        (capture / place).write_bytes(b"no picture")
    imported(bpy, write_model(tmp_path / "model.safetensors", tensors, information))
    camera = next(o for o in bpy.data.objects if o.type == "CAMERA")
    assert not [b for b in camera.data.background_images if b.image.has_data]
    assert "Traceback" not in "".join(capfd.readouterr())


@pytest.mark.parametrize("failing", ["create_camera", "show_frames", "set_timeline", "_make_vehicles"])
def test_failure_leaves_no_half_an_import(
    bpy: Any, extension: str, tmp_path: Path, failing: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_model(tmp_path / "model.safetensors", *make_model(60, FRAMES, groups=3))
    importer = importlib.import_module(f"{extension}.importer")

    def fail(*_: Any) -> None:
        raise MemoryError

    monkeypatch.setattr(importer, failing, fail)
    with pytest.raises(RuntimeError, match="not enough memory for this import"):
        bpy.ops.aa4d.import_model(filepath=str(path))
    for kind in ("objects", "meshes", "cameras", "collections", "actions", "images"):
        assert not list(getattr(bpy.data, kind))
    assert bpy.context.scene.frame_end == 250


def test_folder_whose_name_is_not_utf_8_is_refused_in_one_line(bpy: Any, tmp_path: Path) -> None:
    """Blender could not remember where the model is."""
    folder = tmp_path / "gef\udcfchrt"
    folder.mkdir()
    with pytest.raises(RuntimeError, match=r"^Error: [^\n]*gef\?hrt[^\n]*rename it\.\s*$"):
        bpy.ops.aa4d.import_model(filepath=str(write_model(folder / "model.safetensors", *make_model(20, FRAMES))))
    assert not bpy.data.objects
