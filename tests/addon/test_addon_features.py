"""Time, inspection, links, exports and compositing of the packaged extension, as a person or a script uses them."""

import importlib
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driving import attribute, drawn, go_to, imported, input_path, played, render, set_input, srgb
from model_files import make_model, write_model
from PIL import Image

FRAMES = 5
TIME, LOOK = "AdaAnchor4D Time", "AdaAnchor4D"


def clip_positions(bpy: Any, obj: Any, ranks: list[float]) -> np.ndarray:
    """The positions of a live object at ranks of the clip, before its time was changed."""
    result = []
    for rank in ranks:
        go_to(bpy, rank + 1)
        result.append(attribute(obj.data, "position"))
    return np.array(result)


@pytest.mark.parametrize("baked", [False, True])
@pytest.mark.parametrize(
    ("settings", "frames_and_ranks"),
    [
        ({"Speed": 2.0}, {1: 0, 2: 2, 2.25: 2.5, 9: 4}),
        ({"Start Frame": 3.0, "Reverse": True}, {3: 4, 4.5: 2.5, 7: 0}),
        ({"Outside the Clip": "Loop"}, {5.5: 4, 6: 0, 12.5: 1.5, -1: 3}),
        ({"Outside the Clip": "Back and Forth"}, {6: 3, 9: 0, 10.5: 1.5}),
        ({"Set Time by Hand": True, "Time": 3.5}, {1: 2.5, 40: 2.5}),
    ],
)
def test_clip_time_live_and_baked(
    bpy: Any,
    extension: str,
    model_path: Path,
    baked: bool,
    settings: dict[str, Any],
    frames_and_ranks: dict[float, float],
) -> None:
    obj = imported(bpy, model_path)
    ranks = [float(rank) for rank in frames_and_ranks.values()]
    if baked:  # linear between the keys
        whole = clip_positions(bpy, obj, [0, 1, 2, 3, 4])
        low = np.minimum(np.array(ranks).astype(int), 3)
        share = (np.array(ranks) - low)[:, None, None]
        expected = (1 - share) * whole[low] + share * whole[low + 1]
        assert bpy.ops.aa4d.bake() == {"FINISHED"}
    else:
        expected = clip_positions(bpy, obj, ranks)
    for name, value in settings.items():
        set_input(extension, obj, TIME, name, value)
    for frame, positions in zip(frames_and_ranks, expected, strict=True):
        go_to(bpy, frame)
        np.testing.assert_allclose(played(bpy, obj)["position"], positions, atol=2e-4)


@pytest.mark.parametrize("baked", [False, True])
def test_time_set_by_hand_can_be_keyed(bpy: Any, extension: str, model_path: Path, baked: bool) -> None:
    """Animation is evaluated before the points are: what is shown is never a frame late."""
    obj = imported(bpy, model_path)
    expected = clip_positions(bpy, obj, [0, 2, 4])
    if baked:
        bpy.ops.aa4d.bake()
    set_input(extension, obj, TIME, "Set Time by Hand", True)
    for frame, time in ((1, 1.0), (11, 5.0)):
        set_input(extension, obj, TIME, "Time", time)
        obj.keyframe_insert(input_path(extension, obj, TIME, "Time"), frame=frame)
    curve = obj.animation_data.action.layers[0].strips[0].channelbags[0].fcurves[0]
    for point in curve.keyframe_points:
        point.interpolation = "LINEAR"
    for frame, positions in zip((1, 6, 11), expected, strict=True):
        go_to(bpy, frame)
        np.testing.assert_allclose(played(bpy, obj)["position"], positions, atol=2e-4)
    if not baked:
        assert bpy.ops.aa4d.bake() == {"FINISHED"}  # the animation survives the change of the group
        go_to(bpy, 6)
        np.testing.assert_allclose(played(bpy, obj)["position"], expected[1], atol=2e-4)


def test_input_changes_show_without_a_change_of_frame(bpy: Any, extension: str, model_path: Path) -> None:
    obj = imported(bpy, model_path)
    expected = clip_positions(bpy, obj, [3])[0]
    go_to(bpy, 1)
    set_input(extension, obj, TIME, "Start Frame", -2.0)
    np.testing.assert_allclose(attribute(obj.data, "position"), expected, atol=1e-6)


def test_bake_of_a_range_and_with_few_keys(bpy: Any, model_path: Path) -> None:
    obj = imported(bpy, model_path)
    whole = clip_positions(bpy, obj, [0, 1, 2, 3, 4])
    assert bpy.ops.aa4d.bake(use_range=True, first=2, last=4) == {"FINISHED"}
    for frame, rank in ((1, 1), (2, 1), (3, 2), (4, 3), (5, 3)):  # the ends of the range hold
        go_to(bpy, frame)
        np.testing.assert_allclose(played(bpy, obj)["position"], whole[rank], atol=1e-4)
    assert bpy.ops.aa4d.bake(step=3) == {"FINISHED"}  # over the bake before: keys at ranks 0, 2 and 4
    keys = sorted(a.name for a in obj.data.attributes if a.name.startswith("aa_x_"))
    assert keys == ["aa_x_0000", "aa_x_0001", "aa_x_0002"]
    for frame in (1, 3, 5):
        go_to(bpy, frame)
        np.testing.assert_allclose(played(bpy, obj)["position"], whole[frame - 1], atol=1e-4)
    go_to(bpy, 2)
    np.testing.assert_allclose(played(bpy, obj)["position"], (whole[0] + whole[2]) / 2, atol=1e-4)
    with pytest.raises(RuntimeError, match="must not end before it begins"):
        bpy.ops.aa4d.bake(use_range=True, first=4, last=2)
    with pytest.raises(RuntimeError, match="5 frames"):
        bpy.ops.aa4d.bake(use_range=True, first=6, last=9)


def test_cancelled_bake_leaves_everything(bpy: Any, extension: str, model_path: Path) -> None:
    obj = imported(bpy, model_path)
    assert bpy.ops.aa4d.bake() == {"FINISHED"}
    before = sorted(a.name for a in obj.data.attributes)
    bake = importlib.import_module(f"{extension}.bake")
    work = bake.bake(obj, bpy.context.scene, bake.BakeOptions(inspection=True))
    assert next(work) == (1, FRAMES)
    assert len(obj.data.attributes) > len(before)
    work.close()
    assert sorted(a.name for a in obj.data.attributes) == before
    assert obj.aa4d.playback == "BAKED"


def test_bake_runs_as_a_person_sees_it(bpy: Any, extension: str, model_path: Path) -> None:
    """The modal operator, driven by hand: ticks until done, and Esc."""
    from types import SimpleNamespace
    from unittest.mock import MagicMock

    obj = imported(bpy, model_path)
    operators = importlib.import_module(f"{extension}.operators")
    bake = importlib.import_module(f"{extension}.bake")
    for cancel in (True, False):
        operator = MagicMock()
        operator.work = bake.bake(obj, bpy.context.scene, bake.BakeOptions())
        operator._end = lambda _context, _kind, _message, result: result
        context = MagicMock()
        tick, escape = SimpleNamespace(type="TIMER"), SimpleNamespace(type="ESC")
        assert operators.Bake.modal(operator, context, tick) == {"RUNNING_MODAL"}
        if cancel:
            assert operators.Bake.modal(operator, context, escape) == {"CANCELLED"}
            assert obj.aa4d.playback == "LIVE"
            assert not [a.name for a in obj.data.attributes if "unfinished" in a.name]
            continue
        results = [operators.Bake.modal(operator, context, tick) for _ in range(FRAMES)]
        assert results[-1] == {"FINISHED"}
        assert obj.aa4d.playback == "BAKED"


def test_view_follows_the_active_camera_or_is_frozen(bpy: Any, model_path: Path) -> None:
    obj = imported(bpy, model_path, view="ACTIVE", set_up_scene=True)
    bpy.context.scene.camera.animation_data_clear()
    bpy.context.scene.camera.location = (30, -60, 20)
    go_to(bpy, 3)
    here = attribute(obj.data, "aa_color")
    bpy.context.scene.camera.location = (90, -20, 5)
    bpy.context.view_layer.update()
    there = attribute(obj.data, "aa_color")
    assert np.abs(here - there).max() > 0.05
    # Moving the points as well leaves nothing changed between the two.
    obj.location = (10, 20, 30)
    bpy.context.scene.camera.location = (40, -40, 50)
    bpy.context.view_layer.update()
    np.testing.assert_allclose(attribute(obj.data, "aa_color"), here, atol=1e-4)
    assert bpy.ops.aa4d.freeze_view() == {"FINISHED"}
    bpy.context.scene.camera.location = (-90, 20, 5)
    bpy.context.view_layer.update()
    np.testing.assert_allclose(attribute(obj.data, "aa_color"), here, atol=1e-4)


def test_baked_view_follows_the_animated_camera(bpy: Any, model_path: Path) -> None:
    obj = imported(bpy, model_path, view="ACTIVE", set_up_scene=True)
    live = []
    for frame in (1, 3, 5):
        go_to(bpy, frame)
        live.append(srgb(played(bpy, obj)["aa_color"][:, :3]))
    go_to(bpy, 2)
    assert bpy.ops.aa4d.bake() == {"FINISHED"}
    assert bpy.context.scene.frame_current == 2
    for frame, expected in zip((1, 3, 5), live, strict=True):
        go_to(bpy, frame)
        np.testing.assert_allclose(srgb(played(bpy, obj)["aa_color"][:, :3]), expected, atol=1.01 / 255)


@pytest.mark.parametrize("baked", [False, True])
def test_colours_show_the_quantity_asked_for(bpy: Any, extension: str, model_path: Path, baked: bool) -> None:
    """Low and high ends of the legend stand where the smallest and the largest values are."""
    obj = imported(bpy, model_path)
    field = importlib.import_module(f"{extension}.field")
    playback = importlib.import_module(f"{extension}.playback")
    loaded = playback.loaded_of(obj).field
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


def read_ply(path: Path) -> dict[str, np.ndarray]:
    header, data = path.read_bytes().split(b"end_header\n", 1)
    names = [line.split()[2] for line in header.decode().splitlines() if line.startswith("property float")]
    rows = np.frombuffer(data, "<f4").reshape(-1, len(names))
    assert f"element vertex {len(rows)}" in header.decode()
    return dict(zip(names, rows.T, strict=True))


@pytest.mark.parametrize("baked", [False, True])
def test_splats_go_out_as_they_are_shown(bpy: Any, model_path: Path, tmp_path: Path, baked: bool) -> None:
    obj = imported(bpy, model_path, carrier="GAUSSIANS", bake=baked)
    go_to(bpy, 3)
    assert bpy.ops.aa4d.export_ply(filepath=str(tmp_path / "one.ply")) == {"FINISHED"}
    now = played(bpy, obj)
    seen = now["aa_opacity"] >= 0.05
    ply = read_ply(tmp_path / "one.ply")
    np.testing.assert_allclose(np.stack([ply[a] for a in "xyz"], 1), now["position"][seen], atol=1e-5)
    color = 0.5 + 0.28209479177387814 * np.stack([ply[f"f_dc_{i}"] for i in range(3)], 1)
    np.testing.assert_allclose(color, srgb(now["aa_color"][seen, :3]), atol=1e-3)
    np.testing.assert_allclose(1 / (1 + np.exp(-ply["opacity"])), now["aa_opacity"][seen], atol=1e-3)
    scales = np.exp(np.stack([ply[f"scale_{i}"] for i in range(3)], 1))
    np.testing.assert_allclose(scales, now["aa_scale"][seen], rtol=1e-4)
    rotations = np.stack([ply[f"rot_{i}"] for i in range(4)], 1)
    np.testing.assert_allclose(rotations, now["aa_rotation"][seen], atol=1e-5)
    assert bpy.ops.aa4d.export_ply(filepath=str(tmp_path / "many.ply"), use_range=True) == {"FINISHED"}
    assert len(list(tmp_path.glob("many_000?.ply"))) == FRAMES
    assert (tmp_path / "many_0003.ply").read_bytes() == (tmp_path / "one.ply").read_bytes()
    assert bpy.context.scene.frame_current == 3
    with pytest.raises(RuntimeError, match="No such file"):
        bpy.ops.aa4d.export_ply(filepath=str(tmp_path / "missing" / "one.ply"))
    for name in ("", "folder.ply", "one.png"):
        (tmp_path / "folder.ply").mkdir(exist_ok=True)
        for export in (bpy.ops.aa4d.export_ply, bpy.ops.aa4d.export_usd):
            with pytest.raises(RuntimeError, match=r"^Error: [^\n]*name[^\n]*\s*$"):
                export(filepath=str(tmp_path / name) if name else "")
    assert not list(tmp_path.glob(".*"))


def test_usd_points_move(bpy: Any, model_path: Path, tmp_path: Path) -> None:
    obj = imported(bpy, model_path)
    expected = clip_positions(bpy, obj, [0, 3])
    opacity = [attribute(obj.data, "aa_opacity")]
    for frame in range(1, FRAMES + 1):
        go_to(bpy, frame)
        opacity.append(attribute(obj.data, "aa_opacity"))
    seen = np.max(opacity, axis=0) >= 0.05
    count = len(bpy.data.objects)
    path = tmp_path / "points.usdc"
    assert bpy.ops.aa4d.export_usd(filepath=str(path), use_range=True) == {"FINISHED"}
    assert len(bpy.data.objects) == count
    assert bpy.context.active_object == obj
    assert (bpy.context.scene.frame_start, bpy.context.scene.frame_end) == (1, FRAMES)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.wm.usd_import(filepath=str(path))
    cloud = next(o for o in bpy.data.objects if o.type == "POINTCLOUD")
    for frame, positions in zip((1, 4), expected, strict=True):
        go_to(bpy, frame)
        data = cloud.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        matrix = np.array(cloud.matrix_world)
        places = attribute(data, "position") @ matrix[:3, :3].T + matrix[:3, 3]
        np.testing.assert_allclose(places, positions[seen], atol=1e-3)


def test_ground_is_found_under_what_stands_on_it(extension: str) -> None:
    compositing = importlib.import_module(f"{extension}.compositing")
    random = np.random.default_rng(2)
    xy = random.uniform(-50, 50, (4000, 2))
    z = 0.02 * xy[:, 0] - 0.01 * xy[:, 1] + 100 + random.normal(0, 0.05, 4000)
    z[:1200] += random.uniform(0.5, 25, 1200)
    ground = compositing.fit_ground(np.column_stack([xy, z]).astype(np.float32))
    np.testing.assert_allclose(ground.slope, [0.02, -0.01], atol=2e-3)
    assert abs(ground.z(np.zeros(2)) - 100) < 0.1


def wall_scene(bpy: Any, tmp_path: Path, **options: Any) -> Any:
    """One large opaque Gaussian that fills the middle of the picture, a red cube half behind it and half beside it."""
    tensors, information = make_model(1, 1, stage="coarse")
    for name, tensor in tensors.items():
        if name.startswith("decoder_"):
            tensors[name] = np.zeros_like(tensor)
    tensors["decoder_opacity.output.bias"][:] = 10
    tensors["decoder_color.output.bias"][:] = np.tile([2.0, 2.0, -2.0], 3)
    tensors["decoder_covariance.output.bias"].reshape(3, 7)[:, 3] = 1
    tensors["anchors.position"][:] = tensors["anchors.offset"][:] = 0
    tensors["anchors.log_scale"][:] = -1.0
    information["camera"] = {"model": "PINHOLE", "width": 96, "height": 54, "K": [[80, 0, 48], [0, 80, 27], [0, 0, 1]]}
    path = write_model(tmp_path / "model.safetensors", tensors, information)
    obj = imported(bpy, path, set_up_scene=True, **options)
    camera = bpy.context.scene.camera
    bpy.ops.mesh.primitive_cube_add(size=6)
    cube = bpy.context.active_object
    bpy.context.view_layer.update()
    place = camera.matrix_world @ __import__("mathutils").Vector((6, 0, -60))
    cube.location = place
    material = bpy.data.materials.new("red")
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    material.node_tree.nodes.clear()
    glow, output = (material.node_tree.nodes.new(n) for n in ("ShaderNodeEmission", "ShaderNodeOutputMaterial"))
    glow.inputs[0].default_value = (1, 0, 0, 1)
    material.node_tree.links.new(glow.outputs[0], output.inputs[0])
    cube.data.materials.append(material)
    bpy.context.view_layer.objects.active = obj
    return obj


@pytest.mark.parametrize("look", ["Points", "Discs", "Gaussians"])
def test_what_is_behind_the_points_is_hidden(bpy: Any, tmp_path: Path, look: str) -> None:
    obj = wall_scene(bpy, tmp_path, carrier="GAUSSIANS", look=look)
    pixels = render(bpy, tmp_path / "with.png")
    obj.hide_render = True
    alone = render(bpy, tmp_path / "without.png")
    red = (alone[..., 0] > 0.9) & (alone[..., 1] < 0.1)
    still = (pixels[..., 0] > 0.9) & (pixels[..., 1] < 0.1)
    assert red.sum() > 40
    assert 0.1 < still.sum() / red.sum() < 0.9
    tolerance = 4 if look == "Gaussians" else 2  # the pixel's centre is not quite the Gaussian's
    np.testing.assert_allclose(pixels[27, 48, :3], 1 / (1 + np.exp([-2, -2, 2])), atol=tolerance / 255)


def test_over_the_footage_only_the_new_is_seen(bpy: Any, extension: str, tmp_path: Path) -> None:
    """Holdout: the points hide the cube and are not seen; depth, Cryptomatte and ids are there for the compositor."""
    obj = wall_scene(bpy, tmp_path, carrier="GAUSSIANS", look="Points")
    assert bpy.ops.aa4d.set_up_compositing(mode="PLATE") == {"FINISHED"}
    assert obj.is_holdout
    set_input(extension, obj, LOOK, "Crop", "Off")  # one point has no ground to stand on
    for name in [o.name for o in bpy.data.objects if o.name.endswith("Ground")]:
        bpy.data.objects.remove(bpy.data.objects[name])
    pixels = render(bpy, tmp_path / "plate.png")
    seen = pixels[..., 3] > 0.9
    assert pixels[27, 48, 3] == 0
    assert pixels[2, 2, 3] == 0
    assert seen.sum() > 10
    assert (pixels[seen][:, 0] > 0.9).all()
    layer = bpy.context.view_layer
    assert layer.use_pass_z
    assert layer.use_pass_cryptomatte_object
    assert [aov.name for aov in layer.aovs] == ["AA Anchor"]
    assert bpy.ops.aa4d.set_up_compositing(mode="SCENE") == {"FINISHED"}
    assert not obj.is_holdout
    assert len(layer.aovs) == 1


@pytest.mark.parametrize("mode", ["SCENE", "PLATE"])
def test_a_cg_object_casts_its_shadow_on_the_ground(bpy: Any, tmp_path: Path, mode: str) -> None:
    """A flat field of grey points, a cube over its middle, the sun above: darker, or less transparent, under it."""
    tensors, information = make_model(900, 1, stage="coarse")
    for name, tensor in tensors.items():
        if name.startswith("decoder_"):
            tensors[name] = np.zeros_like(tensor)
    tensors["decoder_opacity.output.bias"][:] = 10
    tensors["decoder_covariance.output.bias"].reshape(3, 7)[:, 3] = 1
    x, y = np.meshgrid(np.linspace(-1, 1, 30), np.linspace(-1, 1, 30))
    tensors["anchors.position"][:] = np.column_stack([x.ravel(), y.ravel(), np.zeros(900)])
    tensors["anchors.offset"][:] = 0
    tensors["anchors.log_scale"][:] = np.log(0.1)
    information["camera"] = {"model": "PINHOLE", "width": 96, "height": 54, "K": [[80, 0, 48], [0, 80, 27], [0, 0, 1]]}
    obj = imported(bpy, write_model(tmp_path / "model.safetensors", tensors, information), set_up_scene=True)
    assert bpy.ops.aa4d.set_up_compositing(mode=mode) == {"FINISHED"}
    sun = next(o for o in bpy.data.objects if o.type == "LIGHT")
    sun.rotation_euler = (0, 0, 0)
    bpy.ops.mesh.primitive_cube_add(size=4)
    cube = bpy.context.active_object
    cube.location = (30, -20, 12)
    cube.visible_camera = False
    pixels = render(bpy, tmp_path / "with.png", samples=16)
    cube.hide_render = True
    alone = render(bpy, tmp_path / "without.png", samples=16)
    channel = 0 if mode == "SCENE" else 3
    change = np.abs(pixels[..., channel] - alone[..., channel])
    rows, columns = np.nonzero(change > 0.2)
    assert len(rows) > 8
    # The middle of the field is the middle of the picture, and so is the shadow from straight above.
    assert abs(rows.mean() - 27) < 6
    assert abs(columns.mean() - 48) < 6
    assert change[:5].max() < 0.1
    if mode == "PLATE":
        assert np.median(alone[..., 3]) == 0
    assert obj.visible_shadow == (mode == "SCENE")


def test_passes_hold_depth_and_anchor(bpy: Any, tmp_path: Path) -> None:
    oiio = pytest.importorskip("OpenImageIO")
    wall_scene(bpy, tmp_path, look="Points")
    assert bpy.ops.aa4d.set_up_compositing(mode="SCENE") == {"FINISHED"}
    scene = bpy.context.scene
    render(bpy, tmp_path / "picture.png")
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):
        settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format = "OPEN_EXR_MULTILAYER"
    scene.render.filepath = str(tmp_path / "passes.exr")
    bpy.ops.render.render(write_still=True)
    path = str(tmp_path / "passes.exr")
    channels: dict[str, np.ndarray] = {}
    for part in range(oiio.ImageBuf(path).nsubimages):  # Blender 5.2 writes a part a pass
        image = oiio.ImageBuf(path, part, 0)
        name, pixels = image.spec().getattribute("name") or "", image.get_pixels(oiio.FLOAT)
        channels.update({f"{name} {c}": pixels[..., i] for i, c in enumerate(image.spec().channelnames)})
    assert any("CryptoObject00" in name for name in channels)
    anchor = next(values for name, values in channels.items() if "AA Anchor" in name)
    depth = next(values for name, values in channels.items() if "Depth" in name)
    assert anchor[27, 48] == 1  # aa_id 0, plus one
    assert anchor[1, 1] == 0
    assert 30 < depth[27, 48] < 60


def moving_point(tmp_path: Path) -> Path:
    """One anchor that crosses the picture evenly, drawn large and white on black."""
    tensors, information = make_model(1, 5)
    for name, tensor in tensors.items():
        if name.startswith(("decoder_", "head_", "dlgd_", "acfa", "encoder")) or ".offset" in name:
            tensors[name] = np.zeros_like(tensor)
    tensors["anchors.position"][:] = [-1.5, 0, 0]
    tensors["anchors.log_scale"][:] = np.log(0.1)
    tensors["decoder_opacity.output.bias"][:] = 10
    tensors["decoder_color.output.bias"][:] = 10
    tensors["decoder_covariance.output.bias"].reshape(3, 7)[:, 3] = 1
    for name, tensor in tensors.items():  # every feature is the time axis of the planes, from 0 to 1
        if name.startswith("field.planes"):
            rising = np.linspace(0, 1, tensor.shape[1])[:, None] if name.endswith("t") else 0
            tensors[name] = np.broadcast_to(rising, tensor.shape).astype(np.float32)
    tensors["encoder.weight"][0, 0] = 6.0  # three of six planes rise: h = t / 2
    tensors["head_position.hidden.weight"][0, 0] = 1.0
    tensors["head_position.output.weight"][0, 0] = 1.0
    information["background"] = [0, 0, 0]
    information["camera"] = {"model": "PINHOLE", "width": 96, "height": 54, "K": [[80, 0, 48], [0, 80, 27], [0, 0, 1]]}
    for frame in information["frames"]:
        frame["viewmat"] = information["frames"][0]["viewmat"]
    return write_model(tmp_path / "model.safetensors", tensors, information)


@pytest.mark.parametrize("look", ["Points", "Gaussians"])
@pytest.mark.parametrize("baked", [False, True])
def test_motion_blur_is_the_average_of_sub_frames(
    bpy: Any, extension: str, tmp_path: Path, baked: bool, look: str
) -> None:
    obj = imported(bpy, moving_point(tmp_path), look=look, carrier="GAUSSIANS", bake=baked, set_up_scene=True)
    scene = bpy.context.scene
    scene.view_settings.view_transform = "Raw"  # averages are of light, not of sRGB values
    go_to(bpy, 3)
    brute = []
    for sub in (np.arange(9) + 0.5) / 9 - 0.5:  # rendering goes to the whole frame: the clip is moved instead
        set_input(extension, obj, TIME, "Start Frame", float(1 - sub))
        brute.append(render(bpy, tmp_path / "sub.png", samples=16))
    set_input(extension, obj, TIME, "Start Frame", 1.0)
    brute = np.mean(brute, axis=0)
    scene.render.use_motion_blur, scene.render.motion_blur_shutter = True, 1.0
    blurred = render(bpy, tmp_path / "blurred.png", samples=64)
    scene.render.use_motion_blur = False
    sharp = render(bpy, tmp_path / "sharp.png", samples=16)
    assert np.abs(sharp - brute)[..., 0].max() > 0.3
    assert np.abs(blurred[..., :3] - brute[..., :3]).mean() < 0.25 * np.abs(sharp[..., :3] - brute[..., :3]).mean()
    weights = [picture[..., 0] / picture[..., 0].sum() for picture in (blurred, brute)]
    for axis in (0, 1):
        places = [(weight.sum(axis=1 - axis) * np.arange(weight.shape[axis])).sum() for weight in weights]
        assert abs(places[0] - places[1]) < 0.5


def test_presets_set_what_exists(bpy: Any, extension: str) -> None:
    """Blender finds them, and each names properties and values that the operator has."""
    operators = importlib.import_module(f"{extension}.operators")
    for name, count in (("aa4d.import_model", 3), ("aa4d.bake", 2)):
        folders = [Path(path) for path in bpy.utils.preset_paths(f"operator/{name}")]
        presets = [preset for folder in folders for preset in folder.glob("*.py")]
        assert len(presets) == count
        cls = next(cls for cls in operators.CLASSES if getattr(cls, "bl_idname", "") == name)
        known = getattr(bpy.ops.aa4d, name.removeprefix("aa4d.")).get_rna_type().properties
        assert "PRESET" in cls.bl_options
        for preset in presets:
            settings = [line for line in preset.read_text().splitlines() if line.startswith("op.")]
            assert settings
            for line in settings:
                key, value = line.removeprefix("op.").split(" = ")
                if known[key].type == "ENUM":
                    assert value.strip('"') in known[key].enum_items
                else:
                    assert value in ("True", "False") or float(value) > 0


def test_translations_are_of_texts_that_exist(bpy: Any, extension: str) -> None:
    table = importlib.import_module(f"{extension}.translations").GERMAN
    folder = Path(importlib.import_module(extension).__file__).parent
    source = "".join(path.read_text() for path in folder.rglob("*.py") if path.name != "translations.py")
    assert [text for text in table if f'"{text}"' not in source and f'"""{text}"""' not in source] == []
    view = bpy.context.preferences.view
    before = view.language, view.use_translate_interface
    if "de_DE" in view.bl_rna.properties["language"].enum_items:
        try:
            view.language, view.use_translate_interface = "de_DE", True
            assert bpy.app.translations.pgettext_iface("Import Model") in ("Modell importieren", "Import Model")
        finally:
            view.language, view.use_translate_interface = before


def test_everything_has_a_tooltip(bpy: Any, extension: str, model_path: Path) -> None:
    operators = importlib.import_module(f"{extension}.operators")
    own = {name for cls in operators.CLASSES for base in cls.__mro__ for name in getattr(base, "__annotations__", {})}
    assert {"carrier", "use_range", "mode"} <= own
    own.discard("filter_glob")
    for cls in operators.CLASSES:
        if not issubclass(cls, bpy.types.Operator):
            continue
        rna = getattr(bpy.ops.aa4d, cls.bl_idname.removeprefix("aa4d.")).get_rna_type()
        assert rna.description
        assert all(
            rna.properties[name].description for name in own - {"filepath", "directory"} if name in rna.properties
        )
    obj = imported(bpy, model_path)
    modifiers = importlib.import_module(f"{extension}.modifiers")
    for modifier in obj.modifiers:
        assert all(item.description for item in modifiers.inputs_of(modifier.node_group))
    assert all(p.description for p in obj.aa4d.bl_rna.properties if p.identifier not in ("rna_type", "name"))


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


def test_what_a_person_took_apart_gives_no_traceback(bpy: Any, model_path: Path, capfd: Any) -> None:
    obj = imported(bpy, model_path)
    expected = clip_positions(bpy, obj, [2])[0]
    go_to(bpy, 1)
    foreign = bpy.data.node_groups.new("foreign", "GeometryNodeTree")
    for modifier in obj.modifiers:
        modifier.node_group = foreign
    capfd.readouterr()
    go_to(bpy, 3)
    np.testing.assert_array_equal(attribute(obj.data, "position"), expected)
    assert bpy.ops.aa4d.bake() == {"FINISHED"}
    assert bpy.ops.aa4d.free_bake() == {"FINISHED"}
    obj.modifiers.clear()
    go_to(bpy, 2)
    obj.data.attributes.remove(obj.data.attributes["aa_id"])
    go_to(bpy, 3)
    go_to(bpy, 4)
    output = "".join(capfd.readouterr())
    assert output.count("has lost its attribute aa_id") == 1
    assert "Traceback" not in output
