"""What the packaged extension shows of a scene beside its picture: quantities, ghosts, filters, grid, labels."""

import importlib
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driving import attribute, clip_positions, drawn, go_to, imported, played, set_input
from model_files import make_model, write_model
from PIL import Image

FRAMES = 5
TIME, LOOK = "AdaAnchor4D Time", "AdaAnchor4D"


@pytest.mark.parametrize("baked", [False, True])
def test_colours_show_the_quantity_asked_for(bpy: Any, extension: str, model_path: Path, baked: bool) -> None:
    """Low and high ends of the legend stand where the smallest and the largest values are."""
    obj = imported(bpy, model_path)
    field = importlib.import_module(f"{extension}.field")
    playback = importlib.import_module(f"{extension}.playback")
    loaded = playback.loaded_of(obj).source.field
    if baked:
        bpy.ops.aa4d.bake(inspection=True)
    go_to(bpy, 4)
    t = 3 / (FRAMES - 1)
    fps = loaded.model.fps
    step = 0.5 / (FRAMES - 1)
    way = field.anchor_positions(loaded, t + step) - field.anchor_positions(loaded, t - step)
    weights = field.plane_weights(loaded, t)
    moved = field.anchor_positions(loaded, t) - loaded.model.tensors["anchors.position"]
    expected = {
        "Displacement": 12 * np.linalg.norm(moved, axis=1),
        "Speed": 12 * np.linalg.norm(way, axis=1) * fps,
        "Motion Share": weights[:, 3:].sum(axis=1),
        "Plane Weight": weights[:, 5],
        "Reach": played(bpy, obj)["aa_radius"],
    }
    obj.modifiers[LOOK].show_viewport = True
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-5)
    set_input(extension, obj, LOOK, "Plane", "zt")
    for name, values in expected.items():
        set_input(extension, obj, LOOK, "Colour By", name)
        set_input(extension, obj, LOOK, "Low", float(np.median(values) - 1e-4))
        set_input(extension, obj, LOOK, "High", float(np.median(values) + 1e-4))
        green = drawn(bpy, obj)["aa_color"][:, 1]
        far = np.abs(values - np.median(values)) > 2e-3
        np.testing.assert_array_equal(green[far] > 0.5, (values > np.median(values))[far], err_msg=name)
        assert far.sum() > 20
    if not baked:
        assert bpy.ops.aa4d.fit_legend() == {"FINISHED"}
        modifiers = importlib.import_module(f"{extension}.modifiers")
        low, high = (modifiers.get(obj.modifiers[LOOK], name) for name in ("Low", "High"))
        assert expected["Reach"].min() <= low < high <= expected["Reach"].max()
    set_input(extension, obj, LOOK, "Colour By", "Anchor")
    assert len(np.unique(drawn(bpy, obj)["aa_color"].round(3), axis=0)) == 60
    set_input(extension, obj, LOOK, "Colour By", "Trained Colour")
    shown = drawn(bpy, obj)["aa_color"]
    np.testing.assert_allclose(shown, played(bpy, obj)["aa_color"], atol=1e-6)


@pytest.mark.parametrize("baked", [False, True])
def test_ghosts_stand_where_the_points_were(bpy: Any, extension: str, model_path: Path, baked: bool) -> None:
    obj = imported(bpy, model_path)
    before = clip_positions(bpy, obj, [2, 1])
    go_to(bpy, 4)
    now = attribute(obj.data, "position")
    if baked:
        bpy.ops.aa4d.bake()
    set_input(extension, obj, LOOK, "Minimum Opacity", 0.0)
    set_input(extension, obj, LOOK, "Ghost Distance", 0.5)
    set_input(extension, obj, TIME, "Trail", 2)
    go_to(bpy, 4)
    cloud = drawn(bpy, obj)
    expected = np.concatenate([now, *(then[np.linalg.norm(then - now, axis=1) > 0.5] for then in before)])
    assert len(expected) > 100
    assert len(cloud["position"]) == len(expected)
    np.testing.assert_allclose(np.sort(cloud["position"], axis=0), np.sort(expected, axis=0), atol=1e-3)


def test_filters_hide(bpy: Any, extension: str, model_path: Path) -> None:
    obj = imported(bpy, model_path)
    go_to(bpy, 4)
    set_input(extension, obj, LOOK, "Minimum Opacity", 0.5)
    shown = drawn(bpy, obj)["radius"] > 0
    opacity = attribute(obj.data, "aa_opacity")
    np.testing.assert_array_equal(shown, opacity >= 0.5)
    set_input(extension, obj, LOOK, "Minimum Opacity", 0.0)
    set_input(extension, obj, LOOK, "Moved at Least", 1e-3)
    moved = attribute(obj.data, "aa_displacement")
    low, high = (float(bound) for bound in np.quantile(moved, [0.31, 0.72]))
    set_input(extension, obj, LOOK, "Moved at Least", low)
    set_input(extension, obj, LOOK, "Moved at Most", high)
    shown = drawn(bpy, obj)["radius"] > 0
    np.testing.assert_array_equal(shown, (moved >= low) & (moved <= high))
    assert 5 < shown.sum() < 55
    set_input(extension, obj, LOOK, "Moved at Least", 0.0)
    set_input(extension, obj, LOOK, "Moved at Most", 1e6)
    positions = attribute(obj.data, "position")
    box = bpy.data.objects.new("box", None)
    bpy.context.collection.objects.link(box)
    box.location, box.scale = positions.mean(axis=0), (11, 7, 8)
    box.rotation_euler = (0, 0, 0.5)
    set_input(extension, obj, LOOK, "Crop Object", box)
    bpy.context.view_layer.update()
    inverse = np.array(box.matrix_world.inverted())
    inside = (np.abs(positions @ inverse[:3, :3].T + inverse[:3, 3]) <= 1).all(axis=1)
    for crop, expected in (("Inside", inside), ("Outside", ~inside), ("Off", np.ones(60, bool))):
        set_input(extension, obj, LOOK, "Crop", crop)
        np.testing.assert_array_equal(drawn(bpy, obj)["radius"] > 0, expected)
    assert 3 < inside.sum() < 57


def test_discs_lie_across_the_thinnest_axis(bpy: Any, model_path: Path) -> None:
    from mathutils import Quaternion

    obj = imported(bpy, model_path, carrier="GAUSSIANS", look="Discs")
    scale, rotation = attribute(obj.data, "aa_scale"), attribute(obj.data, "aa_rotation")
    opacity, positions = attribute(obj.data, "aa_opacity"), attribute(obj.data, "position")
    seen = np.flatnonzero(opacity >= 0.05)
    instances = [
        np.array(instance.matrix_world)
        for instance in bpy.context.evaluated_depsgraph_get().object_instances
        if instance.is_instance and instance.parent.original == obj
    ]
    assert len(instances) == len(seen)
    thinnest = set()
    for matrix, row in zip(instances, seen, strict=True):
        np.testing.assert_allclose(matrix[:3, 3], positions[row], atol=1e-3)
        axes = np.array(Quaternion(rotation[row]).to_matrix())
        least = int(scale[row].argmin())
        thinnest.add(least)
        normal = matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
        assert abs(normal @ axes[:, least]) > 0.999
        across = np.linalg.norm(matrix[:3, :2], axis=0)
        np.testing.assert_allclose(np.sort(across), np.sort(np.delete(scale[row], least)), rtol=1e-3)
        assert np.linalg.det(matrix[:3, :3]) > 0
    assert thinnest == {0, 1, 2}


def test_grid_is_where_the_warp_puts_it(bpy: Any, model_path: Path) -> None:
    """The field's query of every line, by its own code, comes out at equal steps."""
    obj = imported(bpy, model_path)
    assert bpy.ops.aa4d.add_grid() == {"FINISHED"}
    grid = next(o for o in bpy.data.objects if o.name.endswith("DACW Grid"))
    assert grid.parent == obj
    assert grid.hide_render
    places = np.array([v.co[:] for v in grid.data.vertices])
    tensors, information = make_model(60, FRAMES)
    to_world = np.array(information["model_to_world"])
    local = (places - to_world[:3, 3]) / to_world[0, 0]
    lower, upper = tensors["field.box"]
    for axis in range(3):
        u = np.unique((2 * (local[:, axis] - lower[axis]) / (upper[axis] - lower[axis]) - 1).round(5))
        boundaries = tensors["warp.boundaries"][axis]
        warped = np.interp(u, np.linspace(-1, 1, len(boundaries)), boundaries)
        np.testing.assert_allclose(warped, np.linspace(-1, 1, 33), atol=1e-4)


def test_statistics_of_the_selection(bpy: Any, extension: str, model_path: Path) -> None:
    obj = imported(bpy, model_path)
    obj.data.vertices.foreach_set("select", np.arange(60) < 7)
    bpy.ops.object.mode_set(mode="EDIT")
    try:
        assert bpy.ops.aa4d.measure_selection() == {"FINISHED"}
    finally:
        bpy.ops.object.mode_set(mode="OBJECT")
    text = importlib.import_module(f"{extension}.operators.inspection").statistics[obj.session_uid]
    assert text[0] == "7 of 60 points"
    center = attribute(obj.data, "position")[:7].mean(axis=0)
    assert text[1] == "centre {:.2f}, {:.2f}, {:.2f} m".format(*center)


def test_activity_of_the_capture_colours_the_anchors(bpy: Any, tmp_path: Path) -> None:
    """Left half of every frame persistent, right half static; the depth hides the farther half of the anchors."""
    capture = tmp_path / "capture"
    (capture / "truth" / "activity").mkdir(parents=True)
    (capture / "capture.json").write_text(json.dumps({"format": "aa4d-capture"}))
    tensors, information = make_model(80, 3, stage="coarse")
    tensors["anchors.position"][:, 2] = np.where(np.arange(80) < 40, 0.8, -3.0)
    information["capture"] = "capture"
    labels = np.zeros((180, 320), np.uint8)
    labels[:, :160] = 2
    for frame in information["frames"]:
        frame["viewmat"] = [[1, 0, 0, -30], [0, -1, 0, -20], [0, 0, -1, 60], [0, 0, 0, 1]]  # from straight above
        Image.fromarray(labels).save(capture / "truth" / "activity" / f"{frame['name']}.png")
        np.savez(capture / "truth" / f"{frame['name']}.npz", depth_z=np.full((180, 320), 60, np.float32))
    obj = imported(bpy, write_model(tmp_path / "model.safetensors", tensors, information), carrier="GAUSSIANS")
    assert bpy.ops.aa4d.label_activity() == {"FINISHED"}
    found = attribute(obj.data, "aa_activity")
    x = 12 * tensors["anchors.position"][:, 0] + 30 - 30
    depth = 60 - (12 * tensors["anchors.position"][:, 2] + 4)
    column = 260 * x / depth + 166.5
    expected = np.where(depth > 61, -1, np.where(column < 160, 2, 0))
    np.testing.assert_array_equal(found, np.repeat(expected, 3))
    assert set(expected) == {-1, 0, 2}
    shutil.rmtree(capture / "truth")
    with pytest.raises(RuntimeError, match="holds no activity labels"):
        bpy.ops.aa4d.label_activity()
    shutil.rmtree(capture)
    with pytest.raises(RuntimeError, match="is not beside it"):
        bpy.ops.aa4d.label_activity()
