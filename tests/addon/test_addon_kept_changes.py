"""What a person did stays or is refused in a sentence: linked duplicates, applied transforms, other files' objects."""

import importlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
from driving import attribute, clip_positions, drawn, go_to, imported, set_input
from model_files import make_model, write_model

FRAMES = 5
TIME, LOOK = "AdaAnchor4D Time", "AdaAnchor4D"


def linked_duplicate(bpy: Any, obj: Any) -> Any:
    """As Alt D makes it, active."""
    for selected in bpy.context.selected_objects:
        selected.select_set(False)
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj
    assert bpy.ops.object.duplicate(linked=True) == {"FINISHED"}
    duplicate = bpy.context.active_object
    assert duplicate != obj
    assert duplicate.data == obj.data
    return duplicate


def in_world(bpy: Any, obj: Any, frame: float) -> np.ndarray:
    """Where the points are drawn."""
    go_to(bpy, frame)
    places, matrix = drawn(bpy, obj)["position"], np.array(obj.matrix_world)
    return places @ matrix[:3, :3].T + matrix[:3, 3]


def test_freeing_a_linked_duplicate_leaves_the_original_baked(bpy: Any, model_path: Path) -> None:
    obj = imported(bpy, model_path, bake=True)
    expected = {frame: in_world(bpy, obj, frame) for frame in (2, 5)}
    duplicate = linked_duplicate(bpy, obj)
    assert bpy.ops.aa4d.free_bake() == {"FINISHED"}
    assert (obj.aa4d.playback, duplicate.aa4d.playback) == ("BAKED", "LIVE")
    assert not [a.name for a in duplicate.data.attributes if a.name.startswith("aa_x_")]
    for frame, places in expected.items():
        np.testing.assert_allclose(in_world(bpy, obj, frame), places, atol=1e-4)
        np.testing.assert_allclose(in_world(bpy, duplicate, frame), places, atol=1e-4)


@pytest.mark.parametrize("acted_on", ["original", "duplicate"])
def test_baking_or_relinking_one_of_two_leaves_the_other(
    bpy: Any, model_path: Path, tmp_path: Path, acted_on: str
) -> None:
    obj = imported(bpy, model_path)
    before = clip_positions(bpy, obj, [0, 3])
    duplicate = linked_duplicate(bpy, obj)
    one, other = (obj, duplicate) if acted_on == "original" else (duplicate, obj)
    bpy.context.view_layer.objects.active = one
    assert bpy.ops.aa4d.bake() == {"FINISHED"}
    assert other.aa4d.playback == "LIVE"
    assert "aa_x_0000" not in other.data.attributes
    second = write_model(tmp_path / "second.safetensors", *make_model(60, FRAMES, seed=4))
    assert bpy.ops.aa4d.free_bake() == {"FINISHED"}
    assert bpy.ops.aa4d.relink(filepath=str(second)) == {"FINISHED"}
    for frame, places in zip((1, 4), before, strict=True):
        go_to(bpy, frame)
        np.testing.assert_array_equal(attribute(other.data, "position"), places)
        assert np.abs(attribute(one.data, "position") - places).max() > 1


def test_live_duplicate_has_a_time_of_its_own(bpy: Any, extension: str, model_path: Path) -> None:
    """And shares the points while it shows the same."""
    obj = imported(bpy, model_path)
    expected = clip_positions(bpy, obj, [1, 3])
    duplicate = linked_duplicate(bpy, obj)
    go_to(bpy, 2)
    assert duplicate.data == obj.data
    set_input(extension, duplicate, TIME, "Start Frame", -1.0)
    go_to(bpy, 2)
    np.testing.assert_allclose(in_world(bpy, obj, 2), expected[0], atol=1e-5)
    np.testing.assert_allclose(in_world(bpy, duplicate, 2), expected[1], atol=1e-5)


def test_look_of_a_duplicate_gets_what_it_needs(bpy: Any, extension: str, model_path: Path) -> None:
    obj = imported(bpy, model_path)
    duplicate = linked_duplicate(bpy, obj)
    set_input(extension, duplicate, LOOK, "Colour By", "Speed")
    go_to(bpy, 3)
    assert duplicate.data == obj.data
    assert attribute(duplicate.data, "aa_speed").max() > 0.1


@pytest.mark.parametrize("baked", [False, True])
def test_duplicate_rests_while_the_original_is_edited(bpy: Any, model_path: Path, baked: bool, capfd: Any) -> None:
    obj = imported(bpy, model_path, bake=baked)
    expected = in_world(bpy, obj, 4)
    duplicate = linked_duplicate(bpy, obj)
    bpy.context.view_layer.objects.active = obj
    go_to(bpy, 1)
    bpy.ops.object.mode_set(mode="EDIT")
    capfd.readouterr()
    go_to(bpy, 3)
    bpy.ops.object.mode_set(mode="OBJECT")
    for one in (obj, duplicate):
        np.testing.assert_allclose(in_world(bpy, one, 4), expected, atol=1e-4)
    assert "Traceback" not in "".join(capfd.readouterr())


def test_duplicated_vehicle_is_baked_with_the_others(bpy: Any, tmp_path: Path) -> None:
    obj = imported(bpy, write_model(tmp_path / "model.safetensors", *make_model(60, FRAMES, groups=3)))
    car = bpy.data.objects["car 1"]
    expected = in_world(bpy, car, 4)
    duplicate = linked_duplicate(bpy, car)
    bpy.context.view_layer.objects.active = obj
    assert bpy.ops.aa4d.bake() == {"FINISHED"}
    go_to(bpy, 1)
    for one in (car, duplicate):
        np.testing.assert_allclose(in_world(bpy, one, 4), expected, atol=1e-4)


def apply(bpy: Any, obj: Any, what: str) -> None:
    """One of Blender's operators on the points themselves."""
    bpy.context.view_layer.objects.active = obj
    for other in bpy.context.selected_objects:
        other.select_set(False)
    obj.select_set(True)
    if what == "origin":
        assert bpy.ops.object.origin_set(type="ORIGIN_GEOMETRY", center="MEDIAN") == {"FINISHED"}
        assert np.abs(obj.location).max() > 1
    elif what == "edit mode":
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.mesh.select_all(action="SELECT")
        bpy.ops.transform.translate(value=(0, 0, 30))
        bpy.ops.object.mode_set(mode="OBJECT")
    else:
        names = ("location", "rotation", "scale")
        assert bpy.ops.object.transform_apply(**{name: name in what for name in names}) == {"FINISHED"}
    bpy.context.view_layer.update()


@pytest.mark.parametrize("baked", [False, True])
@pytest.mark.parametrize("what", ["scale", "rotation", "location rotation scale", "origin", "edit mode"])
def test_what_was_applied_to_the_points_stays(bpy: Any, model_path: Path, baked: bool, what: str) -> None:
    obj = imported(bpy, model_path, bake=baked)
    obj.location, obj.rotation_euler, obj.scale = (5, 6, 7), (0.3, 0, 1), (2, 2, 2)
    expected = {frame: in_world(bpy, obj, frame) for frame in (1, 2.5, 4)}
    if what == "edit mode":
        expected = {frame: places + np.array([0, 0, 30]) for frame, places in expected.items()}
    go_to(bpy, 2)
    apply(bpy, obj, what)
    for frame, places in expected.items():
        np.testing.assert_allclose(in_world(bpy, obj, frame), places, atol=3e-3)
    obj.scale = [2 * size for size in obj.scale]
    bpy.context.view_layer.update()
    again = in_world(bpy, obj, 4)
    apply(bpy, obj, "location rotation scale")  # on top of the first
    assert tuple(obj.scale) == (1, 1, 1)
    in_world(bpy, obj, 1)
    np.testing.assert_allclose(in_world(bpy, obj, 4), again, atol=6e-3)
    assert bpy.ops.aa4d.free_bake() == {"FINISHED"}
    np.testing.assert_allclose(in_world(bpy, obj, 4), again, atol=6e-3)
    assert bpy.ops.aa4d.bake() == {"FINISHED"}
    in_world(bpy, obj, 1)
    np.testing.assert_allclose(in_world(bpy, obj, 4), again, atol=6e-3)


@pytest.mark.parametrize("baked", [False, True])
def test_gaussians_keep_their_shape_when_the_scale_is_applied(bpy: Any, model_path: Path, baked: bool) -> None:
    obj = imported(bpy, model_path, carrier="GAUSSIANS", look="Gaussians", bake=baked)
    obj.rotation_euler, obj.scale = (0.3, 0, 1), (2, 2, 2)

    def instances(frame: int) -> list[np.ndarray]:
        go_to(bpy, frame)
        found = [
            np.array(i.matrix_world) for i in bpy.context.evaluated_depsgraph_get().object_instances if i.is_instance
        ]
        return [np.column_stack([m[:3, :3] @ m[:3, :3].T, m[:3, 3]]) for m in found]

    expected = instances(4)
    go_to(bpy, 1)
    apply(bpy, obj, "location rotation scale")
    np.testing.assert_allclose(instances(4), expected, atol=3e-3)


def test_vehicles_stay_where_they_are_when_the_world_is_applied(bpy: Any, tmp_path: Path) -> None:
    obj = imported(bpy, write_model(tmp_path / "model.safetensors", *make_model(60, FRAMES, groups=3)))
    obj.location, obj.scale = (5, 6, 7), (2, 2, 2)
    car, handle = bpy.data.objects["car 1"], bpy.data.objects["car 1 Handle"]
    go_to(bpy, 4)
    place = handle.matrix_world.translation.copy()
    expected = in_world(bpy, car, 4)
    go_to(bpy, 1)
    apply(bpy, obj, "location rotation scale")
    np.testing.assert_allclose(in_world(bpy, car, 4), expected, atol=1e-3)
    np.testing.assert_allclose(handle.matrix_world.translation, place, atol=1e-3)
    car.scale = (3, 3, 3)
    bpy.context.view_layer.update()
    expected = in_world(bpy, car, 4)
    go_to(bpy, 1)
    apply(bpy, car, "scale")
    np.testing.assert_allclose(in_world(bpy, car, 4), expected, atol=3e-3)


def test_view_of_applied_points_is_the_same(bpy: Any, model_path: Path) -> None:
    """The colours of the active camera and of a frozen view do not change with the metres of the mesh."""
    obj = imported(bpy, model_path, view="ACTIVE", set_up_scene=True)
    obj.scale, obj.location = (2, 2, 2), (3, 0, 0)
    bpy.context.scene.camera.animation_data_clear()
    go_to(bpy, 4)
    expected = attribute(obj.data, "aa_color")
    go_to(bpy, 1)
    apply(bpy, obj, "location rotation scale")
    go_to(bpy, 4)
    np.testing.assert_allclose(attribute(obj.data, "aa_color"), expected, atol=1e-4)
    assert bpy.ops.aa4d.freeze_view() == {"FINISHED"}
    bpy.context.scene.camera.location = (0, 0, 500)
    go_to(bpy, 1)
    go_to(bpy, 4)
    np.testing.assert_allclose(attribute(obj.data, "aa_color"), expected, atol=1e-4)


def test_grid_and_numbers_are_of_the_world(bpy: Any, extension: str, model_path: Path) -> None:
    """Before and after the transform of the points was applied."""
    obj = imported(bpy, model_path)
    obj.location, obj.scale = (5, 6, 7), (2, 2, 2)
    go_to(bpy, 4)
    found = []
    for step in range(2):
        assert bpy.ops.aa4d.add_grid() == {"FINISHED"}
        grid = [o for o in bpy.data.objects if "DACW Grid" in o.name][step]
        bpy.context.view_layer.update()
        corners = np.array([(grid.matrix_world @ vertex.co)[:] for vertex in grid.data.vertices])
        obj.data.vertices.foreach_set("select", np.arange(60) < 7)
        assert bpy.ops.aa4d.measure_selection() == {"FINISHED"}
        line = importlib.import_module(f"{extension}.operators.inspection").statistics[obj.session_uid][1]
        assert line == "centre {:.2f}, {:.2f}, {:.2f} m".format(*in_world(bpy, obj, 4)[:7].mean(axis=0))
        found.append(corners)
        go_to(bpy, 1)
        apply(bpy, obj, "location rotation scale")
        go_to(bpy, 4)
    np.testing.assert_allclose(found[0], found[1], atol=1e-3)


def test_points_moved_one_by_one_go_back_and_that_is_said(bpy: Any, model_path: Path, capfd: Any) -> None:
    obj = imported(bpy, model_path)
    expected = clip_positions(bpy, obj, [0, 3])
    go_to(bpy, 1)
    moved = expected[0].copy()
    moved[7] += 1
    obj.data.attributes["position"].data.foreach_set("vector", moved.ravel())
    obj.data.update()
    capfd.readouterr()
    go_to(bpy, 4)
    np.testing.assert_array_equal(attribute(obj.data, "position"), expected[1])
    assert "".join(capfd.readouterr()).count("moved by hand are back") == 1


@pytest.mark.parametrize("override", [False, True])
def test_live_object_of_another_file_says_that_it_stands_still(
    bpy: Any, extension: str, model_path: Path, tmp_path: Path, override: bool, capfd: Any
) -> None:
    name = imported(bpy, model_path).name
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "work.blend"))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "work.blend"), link=True) as (_, into):
        into.objects = [name]
    obj = bpy.data.objects[name]
    bpy.context.scene.collection.objects.link(obj)
    if override:
        obj = obj.override_create(remap_local_usages=True)
        assert obj.library is None
    bpy.context.view_layer.objects.active = obj
    capfd.readouterr()
    for frame in (2, 4, 3):
        go_to(bpy, frame)
    assert "".join(capfd.readouterr()).count("stands still") == 1
    layout = MagicMock()
    importlib.import_module(f"{extension}.panel").ImportPanel.draw(SimpleNamespace(layout=layout), bpy.context)
    said = " ".join(call.kwargs["text"] for call in layout.mock_calls if "text" in call.kwargs)
    assert "stands still" in said.replace("Stands", "stands")
    assert "Live" not in said


def test_object_that_is_only_instanced_plays(bpy: Any, model_path: Path) -> None:
    obj = imported(bpy, model_path)
    expected = clip_positions(bpy, obj, [0, 3])
    hidden = bpy.data.collections.new("hidden")  # in no scene
    hidden.objects.link(obj)
    bpy.context.scene.collection.objects.unlink(obj)
    instance = bpy.data.objects.new("instance", None)
    instance.instance_type, instance.instance_collection = "COLLECTION", hidden
    bpy.context.scene.collection.objects.link(instance)
    for frame, places in zip((1, 4), expected, strict=True):
        go_to(bpy, frame)
        np.testing.assert_array_equal(attribute(obj.data, "position"), places)
