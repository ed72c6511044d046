"""The packaged extension, driven as a person or a script does: operators, the timeline, save and reload."""

import importlib
import os
import shutil
import zipfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
from bad_model_files import BAD_FILES, OVERFLOWING
from driving import attribute, go_to, imported, played, set_input, srgb
from model_files import make_model, write_model
from slow_reference import evaluate

FRAMES = 5


def expected_at(frame: float) -> dict[str, np.ndarray]:
    """The specification at a frame of the timeline, seen by the capture's camera."""
    tensors, information = make_model(60, FRAMES)
    rank = frame - 1
    centers = [-np.array(f["viewmat"])[:3, :3].T @ np.array(f["viewmat"])[:3, 3] for f in information["frames"]]
    low = min(int(rank), FRAMES - 2)
    center = centers[low] + (rank - low) * (centers[low + 1] - centers[low])
    return evaluate(tensors, information, rank / (FRAMES - 1), center)


def test_package_is_lean(extension_zip: Path) -> None:
    with zipfile.ZipFile(extension_zip) as package:
        names = package.namelist()
        text = b"".join(package.read(name) for name in names)
    assert "blender_manifest.toml" in names
    assert "__init__.py" in names
    assert not {"build_extension.py", "make_flyover_blend.py"} & set(names)
    assert not [name for name in names if "test" in name or "__pycache__" in name or name.endswith((".whl", ".blend"))]
    assert b"torch" not in text
    assert b"import pickle" not in text
    assert b"allow_pickle=True" not in text


def test_disables_and_enables_again(extension: str) -> None:
    import bpy

    for _ in range(2):
        bpy.ops.preferences.addon_disable(module=extension)
        assert not hasattr(bpy.types, "AA4D_PT_import")
        bpy.ops.preferences.addon_enable(module=extension)
        assert bpy.types.AA4D_PT_import.bl_label == "Import AdaAnchor4D"
    assert bpy.types.AA4D_PT_import.bl_space_type == "VIEW_3D"
    assert bpy.types.AA4D_PT_import.bl_region_type == "UI"


def test_panel_shows_the_active_object(bpy: Any, extension: str, model_path: Path) -> None:
    """Drawn into a stand-in for the layout: without a window Blender draws no panels."""
    draw = importlib.import_module(f"{extension}.panel").ImportPanel.draw
    layout = MagicMock()
    draw(SimpleNamespace(layout=layout), bpy.context)
    layout.operator.assert_called_once()
    imported(bpy, model_path)
    draw(SimpleNamespace(layout=layout), bpy.context)
    column = layout.column.return_value
    labels = [call.kwargs["text"] for call in column.label.call_args_list]
    assert labels[0] == "60 Anchors"
    assert labels[1].startswith("Live: ")
    assert bpy.ops.aa4d.bake() == {"FINISHED"}
    draw(SimpleNamespace(layout=layout), bpy.context)
    assert column.label.call_args.kwargs["text"] == "Baked"


@pytest.mark.parametrize("look", ["Points", "Discs", "Gaussians"])
@pytest.mark.parametrize("shown", ["Trained Colour", "Plane Weight", "Speed", "Activity"])
def test_panels_draw_properties_that_exist(bpy: Any, extension: str, model_path: Path, look: str, shown: str) -> None:
    panel = importlib.import_module(f"{extension}.panel")
    obj = imported(bpy, model_path, look=look)
    set_input(extension, obj, "AdaAnchor4D", "Colour By", shown)
    drawn = []
    for cls in (panel.TimePanel, panel.LookPanel, panel.InspectionPanel, panel.OutputPanel):
        layout = MagicMock()
        layout.column.return_value = layout.box.return_value = layout.row.return_value = layout
        stand_in = SimpleNamespace(layout=layout)
        stand_in.draw_legend = lambda *given: panel.InspectionPanel.draw_legend(None, *given)
        assert cls.poll(bpy.context)
        cls.draw(stand_in, bpy.context)
        for call in layout.prop.call_args_list:
            owner, path = call.args
            assert (owner.path_resolve(path) if path.startswith("[") else getattr(owner, path)) is not None
            drawn.append(call.kwargs.get("text"))
        drawn += [call.kwargs.get("text") for call in layout.label.call_args_list]
    assert {"Start Frame", "Look", "Colour By", "Trail", "Cast Shadows"} <= set(drawn)
    assert ("Low" in drawn or "Low (m/s)" in drawn) == (shown in ("Plane Weight", "Speed"))


@pytest.mark.parametrize("frame", [1.0, 2.0, 2.5, 4.5, 5.0])
@pytest.mark.parametrize("carrier", ["ANCHORS", "GAUSSIANS"])
def test_live_points_follow_the_specification(bpy: Any, model_path: Path, carrier: str, frame: float) -> None:
    obj = imported(bpy, model_path, carrier=carrier)
    go_to(bpy, frame)
    expected = expected_at(frame)
    positions = expected["anchors" if carrier == "ANCHORS" else "positions"].reshape(-1, 3)
    extent = np.ptp(positions, axis=0).max()
    assert np.abs(played(bpy, obj)["position"] - positions).max() < 1e-4 * extent
    if carrier == "GAUSSIANS":
        np.testing.assert_allclose(
            srgb(attribute(obj.data, "aa_color")[:, :3]), expected["colors"].reshape(-1, 3), atol=1e-4
        )
        np.testing.assert_allclose(attribute(obj.data, "aa_scale"), expected["scales"].reshape(-1, 3), atol=1e-4)
        np.testing.assert_allclose(
            attribute(obj.data, "aa_rotation"), expected["quaternions"].reshape(-1, 4), atol=1e-4
        )


def test_draws_what_is_opaque_enough(bpy: Any, model_path: Path) -> None:
    anchors = imported(bpy, model_path)
    geometry = anchors.evaluated_get(bpy.context.evaluated_depsgraph_get()).evaluated_geometry()
    cloud = geometry.pointcloud
    opacity = attribute(anchors.data, "aa_opacity")
    np.testing.assert_array_equal(attribute(cloud, "aa_id"), np.arange(60))
    radius = np.where(opacity >= 0.05, attribute(anchors.data, "aa_radius"), 0)
    assert 0 < (radius == 0).sum() < 60
    np.testing.assert_allclose(attribute(cloud, "radius"), radius)
    gaussians = imported(bpy, model_path, carrier="GAUSSIANS", look="Gaussians")
    centers, sizes = [], []
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        if instance.is_instance and instance.parent.original == gaussians:
            centers.append(instance.matrix_world.translation[:])
            sizes.append(instance.matrix_world.to_scale()[:])
    drawn = attribute(gaussians.data, "aa_opacity") >= 0.05
    assert 0 < drawn.sum() < len(drawn)
    np.testing.assert_allclose(centers, attribute(gaussians.data, "position")[drawn], atol=1e-4)
    np.testing.assert_allclose(sizes, attribute(gaussians.data, "aa_scale")[drawn], rtol=1e-3)


def test_timeline_is_the_clip_and_holds_outside_it(bpy: Any, model_path: Path) -> None:
    obj = imported(bpy, model_path)
    scene = bpy.context.scene
    assert (scene.frame_start, scene.frame_end) == (1, FRAMES)
    assert scene.render.fps / scene.render.fps_base == pytest.approx(29.97)
    assert (scene.render.resolution_x, scene.render.resolution_y) == (320, 180)
    go_to(bpy, FRAMES)
    last = attribute(obj.data, "position")
    go_to(bpy, FRAMES + 10)
    np.testing.assert_array_equal(attribute(obj.data, "position"), last)


def test_settings_of_the_person_stay(bpy: Any, model_path: Path) -> None:
    scene = bpy.context.scene
    scene.render.engine = "BLENDER_WORKBENCH"
    before = scene.view_settings.view_transform, scene.world, scene.camera, scene.frame_end
    imported(bpy, model_path, set_timeline=False)
    assert scene.render.engine == "BLENDER_WORKBENCH"
    assert (scene.view_settings.view_transform, scene.world, scene.camera, scene.frame_end) == before


@pytest.mark.parametrize("carrier", ["ANCHORS", "GAUSSIANS"])
def test_bake_equals_live(bpy: Any, model_path: Path, carrier: str) -> None:
    obj = imported(bpy, model_path, carrier=carrier)
    live = []
    for frame in range(1, FRAMES + 1):
        go_to(bpy, frame)
        live.append(played(bpy, obj))
    assert bpy.ops.aa4d.bake() == {"FINISHED"}
    for frame in range(1, FRAMES + 1):
        go_to(bpy, frame)
        baked = played(bpy, obj)
        assert baked.keys() == live[frame - 1].keys()
        for name, values in live[frame - 1].items():
            if name == "aa_color":  # eight bits a channel
                np.testing.assert_allclose(srgb(baked[name][:, :3]), srgb(values[:, :3]), atol=1.01 / 255)
            elif name == "aa_rotation":  # q and -q are one rotation
                np.testing.assert_allclose(np.abs((baked[name] * values).sum(axis=1)), 1, atol=1e-5)
            else:
                np.testing.assert_allclose(baked[name], values, atol=1.01 / 255 if name == "aa_opacity" else 1e-4)
    go_to(bpy, 3.25)
    between = 0.75 * live[2]["position"] + 0.25 * live[3]["position"]
    np.testing.assert_allclose(played(bpy, obj)["position"], between, atol=1e-4)
    assert bpy.ops.aa4d.free_bake() == {"FINISHED"}
    go_to(bpy, 4)
    np.testing.assert_allclose(played(bpy, obj)["position"], live[3]["position"], atol=1e-6)
    assert not [a.name for a in obj.data.attributes if a.name[-4:].isdigit()]


def test_baked_file_needs_neither_add_on_nor_model(bpy: Any, extension: str, model_path: Path, tmp_path: Path) -> None:
    obj = imported(bpy, model_path, bake=True)
    name = obj.name
    blend = tmp_path / "baked.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    model_path.unlink()
    bpy.ops.preferences.addon_disable(module=extension)
    try:
        bpy.ops.wm.open_mainfile(filepath=str(blend))
        go_to(bpy, 4)
        obj = bpy.data.objects[name]
        geometry = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).evaluated_geometry()
        cloud = geometry.pointcloud
        positions, ids = attribute(cloud, "position"), attribute(cloud, "aa_id")
    finally:
        bpy.ops.preferences.addon_enable(module=extension)
    np.testing.assert_allclose(positions, expected_at(4)["anchors"][ids], atol=1e-3)


def test_drone_camera_projects_as_the_capture(bpy: Any, model_path: Path) -> None:
    from bpy_extras.object_utils import world_to_camera_view
    from mathutils import Vector

    imported(bpy, model_path)
    camera = next(obj for obj in bpy.data.objects if obj.type == "CAMERA")
    _, information = make_model(60, FRAMES)
    K = np.array(information["camera"]["K"])
    world = np.random.default_rng(5).uniform(-10, 10, (20, 3)) + np.array([30, -20, 4])
    for rank in range(FRAMES):
        go_to(bpy, rank + 1)
        viewmat = np.array(information["frames"][rank]["viewmat"])
        for point in world:
            pixel = K @ (viewmat @ [*point, 1])[:3]
            view = world_to_camera_view(bpy.context.scene, camera, Vector(point))
            assert abs(320 * view.x - pixel[0] / pixel[2]) < 0.01
            assert abs(180 * (1 - view.y) - pixel[1] / pixel[2]) < 0.01
            assert view.z == pytest.approx(pixel[2], abs=1e-3)


def test_save_and_reload_keeps_playing(bpy: Any, model_path: Path, tmp_path: Path) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "work.blend"))
    obj = imported(bpy, model_path)
    name = obj.name
    assert obj.aa4d.filepath == "//crossing/model.safetensors"
    bpy.ops.wm.save_mainfile()
    moved = tmp_path / "elsewhere"
    moved.mkdir()
    shutil.move(tmp_path / "work.blend", moved)
    shutil.move(model_path.parent, moved)
    bpy.ops.wm.open_mainfile(filepath=str(moved / "work.blend"))
    go_to(bpy, 3.5)
    positions = attribute(bpy.data.objects[name].data, "position")
    np.testing.assert_allclose(positions, expected_at(3.5)["anchors"], atol=1e-3)


def test_missing_model_is_said_once_and_nothing_is_lost(bpy: Any, model_path: Path, capfd: Any) -> None:
    obj = imported(bpy, model_path)
    go_to(bpy, 2)
    before = attribute(obj.data, "position")
    model_path.unlink()
    capfd.readouterr()
    go_to(bpy, 3)
    go_to(bpy, 4)
    output = "".join(capfd.readouterr())
    assert output.count("model.safetensors cannot be read") == 1
    assert "Traceback" not in output
    np.testing.assert_array_equal(attribute(obj.data, "position"), before)


def test_smaller_model_under_the_same_name_is_refused(bpy: Any, model_path: Path, capfd: Any) -> None:
    imported(bpy, model_path)
    write_model(model_path, *make_model(30, FRAMES))
    capfd.readouterr()
    go_to(bpy, 3)
    output = "".join(capfd.readouterr())
    assert "use Relink" in output
    assert "Traceback" not in output


def test_undo_and_redo(bpy: Any, model_path: Path) -> None:
    bpy.ops.ed.undo_push(message="before")
    done = bpy.ops.aa4d.import_model("EXEC_DEFAULT", True, filepath=str(model_path), carrier="ANCHORS")
    assert done == {"FINISHED"}
    bpy.ops.ed.undo()
    assert not bpy.data.objects
    assert bpy.context.scene.frame_end == 250
    bpy.ops.ed.redo()
    assert {obj.type for obj in bpy.data.objects} == {"MESH", "CAMERA"}
    go_to(bpy, 4)
    obj = next(obj for obj in bpy.data.objects if obj.type == "MESH")
    np.testing.assert_allclose(attribute(obj.data, "position"), expected_at(4)["anchors"], atol=1e-3)


def test_undo_of_a_bake_plays_live_again(bpy: Any, model_path: Path) -> None:
    name = imported(bpy, model_path).name
    go_to(bpy, 2)
    bpy.ops.ed.undo_push(message="imported")
    assert bpy.ops.aa4d.bake("EXEC_DEFAULT", True) == {"FINISHED"}
    go_to(bpy, 4)
    bpy.ops.ed.undo()
    obj = bpy.data.objects[name]
    assert obj.aa4d.playback == "LIVE"
    assert list(obj.modifiers.keys()) == ["AdaAnchor4D Time", "AdaAnchor4D"]
    assert obj.modifiers[0].node_group.name.startswith("AdaAnchor4D Live")
    for frame in (4, 2):
        go_to(bpy, frame)
        np.testing.assert_allclose(attribute(obj.data, "position"), expected_at(frame)["anchors"], atol=1e-3)


def test_two_imports_are_independent(bpy: Any, model_path: Path, tmp_path: Path) -> None:
    other_path = write_model(tmp_path / "model.safetensors", *make_model(45, FRAMES, seed=8))
    first = imported(bpy, model_path)
    second = imported(bpy, other_path)
    third = imported(bpy, model_path)
    assert len({first.data, second.data, third.data}) == 3
    third.modifiers["AdaAnchor4D"].show_viewport = False
    assert bpy.ops.aa4d.bake() == {"FINISHED"}
    bpy.data.objects.remove(third)
    go_to(bpy, 4)
    assert len(second.data.vertices) == 45
    np.testing.assert_allclose(attribute(first.data, "position"), expected_at(4)["anchors"], atol=1e-3)
    assert first.aa4d.playback == second.aa4d.playback == "LIVE"


def test_points_deleted_by_hand_stay_deleted(bpy: Any, model_path: Path) -> None:
    obj = imported(bpy, model_path)
    obj.data.vertices.foreach_set("select", np.arange(60) < 20)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.delete(type="VERT")
    bpy.ops.object.mode_set(mode="OBJECT")
    assert len(obj.data.vertices) == 40
    go_to(bpy, 3)
    np.testing.assert_allclose(attribute(obj.data, "position"), expected_at(3)["anchors"][20:], atol=1e-3)
    assert bpy.ops.aa4d.bake() == {"FINISHED"}
    go_to(bpy, 5)
    np.testing.assert_allclose(played(bpy, obj)["position"], expected_at(5)["anchors"][20:], atol=1e-3)


def test_the_same_frame_twice_is_evaluated_once(bpy: Any, extension: str, model_path: Path) -> None:
    playback = importlib.import_module(f"{extension}.playback")
    obj = imported(bpy, model_path)
    go_to(bpy, 3)
    assert playback.milliseconds[obj.session_uid] > 0
    playback.milliseconds.clear()
    go_to(bpy, 3)
    assert not playback.milliseconds
    go_to(bpy, 4)
    assert obj.session_uid in playback.milliseconds


@pytest.mark.parametrize("kind", BAD_FILES)
def test_unusable_file_gives_one_report_line(bpy: Any, kind: str, tmp_path: Path, capfd: Any) -> None:
    write, words = BAD_FILES[kind]
    path = tmp_path / "model.safetensors"
    write(path)
    # Called from Python, an operator's error report arrives as a RuntimeError.
    with pytest.raises(RuntimeError) as report:
        bpy.ops.aa4d.import_model(filepath=str(path))
    assert str(report.value).startswith("Error: ")
    assert words in str(report.value)
    assert "\n" not in str(report.value).strip()
    assert "Traceback" not in "".join(capfd.readouterr())
    assert not bpy.data.objects
    assert not bpy.data.meshes
    assert bpy.context.scene.frame_end == 250


def test_dropped_file_asks_for_the_options(bpy: Any, extension: str, model_path: Path) -> None:
    """What a drop onto the 3D view calls: the handler's operator, invoked with the file's path."""
    operators = importlib.import_module(f"{extension}.operators")
    handler = next(cls for cls in operators.CLASSES if issubclass(cls, bpy.types.FileHandler))
    assert handler.bl_import_operator == "aa4d.import_model"
    assert handler.bl_file_extensions == model_path.suffix
    assert handler.poll_drop(SimpleNamespace(area=SimpleNamespace(type="VIEW_3D")))
    assert not handler.poll_drop(SimpleNamespace(area=SimpleNamespace(type="TEXT_EDITOR")))
    # Without a window the dialogue is confirmed at once.
    assert bpy.ops.aa4d.import_model("INVOKE_DEFAULT", filepath=str(model_path)) == {"FINISHED"}
    assert bpy.context.active_object.aa4d.filepath


@pytest.mark.parametrize("carrier", ["ANCHORS", "GAUSSIANS"])
@pytest.mark.parametrize("kind", OVERFLOWING)
def test_model_that_overflows_is_refused(bpy: Any, kind: str, carrier: str, tmp_path: Path, capfd: Any) -> None:
    path = tmp_path / "model.safetensors"
    OVERFLOWING[kind](path)
    with pytest.raises(RuntimeError, match="not finite at"):
        bpy.ops.aa4d.import_model(filepath=str(path), carrier=carrier)
    assert "Warning" not in "".join(capfd.readouterr())
    assert not bpy.data.objects
    assert not bpy.data.meshes
    assert not bpy.data.cameras
    assert bpy.context.scene.frame_end == 250


@pytest.mark.parametrize("place", ["", "folder", "pipe", "\udcff.safetensors"])
def test_place_that_is_no_file_is_refused(bpy: Any, place: str, tmp_path: Path, capfd: Any) -> None:
    (tmp_path / "folder").mkdir()
    if hasattr(os, "mkfifo"):  # opening it to read would wait for ever
        os.mkfifo(tmp_path / "pipe")
    with pytest.raises(RuntimeError) as report:
        bpy.ops.aa4d.import_model(filepath=str(tmp_path / place) if place else "")
    message = str(report.value).strip()
    assert ("cannot be read" if place else "No file was chosen") in message
    assert "\n" not in message
    assert "Traceback" not in "".join(capfd.readouterr())


@pytest.mark.parametrize("carrier", ["ANCHORS", "GAUSSIANS"])
def test_rendered_colour_is_the_trained_one(bpy: Any, tmp_path: Path, carrier: str) -> None:
    """One large opaque anchor in the middle of the picture: its sRGB within 2/255, and so the background's."""
    tensors, information = make_model(1, 1, stage="coarse")
    color = np.array([0.8, 0.35, 0.1])
    for name, tensor in tensors.items():
        if name.startswith("decoder_"):
            tensors[name] = np.zeros_like(tensor)
    tensors["decoder_opacity.output.bias"][:] = 10
    tensors["decoder_color.output.bias"][:] = np.tile(np.log(color / (1 - color)), 3)
    tensors["decoder_covariance.output.bias"].reshape(3, 7)[:, 3] = 1
    tensors["anchors.position"][:] = tensors["anchors.offset"][:] = 0
    tensors["anchors.log_scale"][:] = 0
    information["camera"] = {"model": "PINHOLE", "width": 96, "height": 54, "K": [[80, 0, 48], [0, 80, 27], [0, 0, 1]]}
    path = write_model(tmp_path / "model.safetensors", tensors, information)
    imported(bpy, path, carrier=carrier, set_up_scene=True)
    scene = bpy.context.scene
    scene.cycles.samples, scene.cycles.use_denoising = 4, False
    scene.render.filepath = str(tmp_path / "picture.png")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath)
    pixels = np.array(image.pixels[:]).reshape(54, 96, 4)
    np.testing.assert_allclose(pixels[27, 48, :3], color, atol=2 / 255)
    np.testing.assert_allclose(pixels[2, 2, :3], information["background"], atol=2 / 255)
