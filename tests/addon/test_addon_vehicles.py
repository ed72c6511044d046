"""Vehicles in the packaged extension: objects of their own that share one evaluation, live and baked."""

import importlib
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
from driving import attribute, drawn, go_to, imported, input_path, played, render, set_input, srgb
from model_files import make_model, write_model
from slow_reference import evaluate

FRAMES = 5
TIME, LOOK = "AdaAnchor4D Time", "AdaAnchor4D"
CARS = ("car 1", "car 2", "car 3")


def a_model(anchors: int = 60) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Three cars; the second is there from rank 0.8 to 3.2, the third from rank 1.6 on."""
    return make_model(anchors, FRAMES, groups=3)


@pytest.fixture
def traffic(tmp_path: Path) -> Path:
    (tmp_path / "crossing").mkdir()
    return write_model(tmp_path / "crossing" / "model.safetensors", *a_model())


def expected_at(frame: float) -> dict[str, np.ndarray]:
    """The specification at a frame of the timeline, seen by the capture's camera."""
    tensors, information = a_model()
    centers = np.array(
        [-np.array(f["viewmat"])[:3, :3].T @ np.array(f["viewmat"])[:3, 3] for f in information["frames"]]
    )
    rank = frame - 1
    center = [np.interp(rank, np.arange(FRAMES), axis) for axis in centers.T]
    return evaluate(tensors, information, rank / (FRAMES - 1), np.array(center))


def members(bpy: Any, obj: Any) -> list[Any]:
    """The world's object and those of the cars, in order."""
    return [obj, *(bpy.data.objects[name] for name in CARS)]


def test_each_vehicle_is_an_object(bpy: Any, traffic: Path) -> None:
    obj = imported(bpy, traffic)
    group = a_model()[0]["anchors.group"]
    for number, part in enumerate(members(bpy, obj), -1):
        np.testing.assert_array_equal(attribute(part.data, "aa_id"), np.flatnonzero(group == number))
        assert (attribute(part.data, "aa_group") == number).all()
        assert number < 0 or part.parent == obj
    outer = bpy.data.collections["crossing"]
    assert [c.name for c in outer.children] == ["crossing Vehicles", "crossing Handles"]
    assert {o.name for o in outer.children[0].objects} == set(CARS)
    assert {o.type for o in outer.objects} == {"MESH", "CAMERA"}


def test_one_object_where_that_is_wanted(bpy: Any, traffic: Path) -> None:
    obj = imported(bpy, traffic, vehicles=False)
    assert [o.type for o in bpy.data.objects if o.type != "CAMERA"] == ["MESH"]
    np.testing.assert_array_equal(attribute(obj.data, "aa_group"), a_model()[0]["anchors.group"])
    go_to(bpy, 2.5)
    np.testing.assert_allclose(attribute(obj.data, "position"), expected_at(2.5)["anchors"], atol=1e-3)


@pytest.mark.parametrize("frame", [1.0, 2.0, 2.5, 5.0])
@pytest.mark.parametrize("carrier", ["ANCHORS", "GAUSSIANS"])
def test_live_vehicles_follow_the_specification(bpy: Any, traffic: Path, carrier: str, frame: float) -> None:
    obj = imported(bpy, traffic, carrier=carrier)
    go_to(bpy, frame)
    expected = expected_at(frame)
    name = "anchors" if carrier == "ANCHORS" else "positions"
    positions = expected[name].reshape(-1, 3)
    for part in members(bpy, obj):
        ids = attribute(part.data, "aa_id")
        np.testing.assert_allclose(played(bpy, part)["position"], positions[ids], atol=1e-3)
        if carrier == "GAUSSIANS":
            opacity = np.maximum(expected["opacities"].ravel()[ids], 0)
            np.testing.assert_allclose(attribute(part.data, "aa_opacity"), opacity, atol=1e-4)
            colors = expected["colors"].reshape(-1, 3)[ids]
            np.testing.assert_allclose(srgb(attribute(part.data, "aa_color")[:, :3]), colors, atol=1e-4)


def test_a_frame_is_evaluated_once_for_all_vehicles(
    bpy: Any, extension: str, traffic: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where they look different, and another one's look needs more."""
    obj = imported(bpy, traffic)
    set_input(extension, bpy.data.objects["car 2"], LOOK, "Look", "Gaussians")
    set_input(extension, bpy.data.objects["car 3"], LOOK, "Colour By", "Speed")
    carriers = importlib.import_module(f"{extension}.carriers")
    calls, evaluate_once = [], carriers.evaluate
    monkeypatch.setattr(carriers, "evaluate", lambda *given: calls.append(given) or evaluate_once(*given))
    before = [attribute(part.data, "position") for part in members(bpy, obj)]
    go_to(bpy, 3)
    assert len(calls) == 1
    for part, place in zip(members(bpy, obj), before, strict=True):
        assert np.abs(attribute(part.data, "position") - place).max() > 0.1
    assert "aa_speed" in bpy.data.objects["car 3"].data.attributes
    assert "aa_speed" not in obj.data.attributes


@pytest.mark.parametrize("baked", [False, True])
def test_what_is_hidden_or_absent_is_not_drawn(bpy: Any, extension: str, traffic: Path, baked: bool) -> None:
    obj = imported(bpy, traffic, bake=baked)
    for part in members(bpy, obj):
        set_input(extension, part, LOOK, "Minimum Opacity", 0.0)
    for frame, there in ((1, "car 1"), (2, "car 1 car 2"), (3, "car 1 car 2 car 3"), (5, "car 1 car 3")):
        go_to(bpy, frame)
        for name in CARS:
            assert (drawn(bpy, bpy.data.objects[name])["radius"] > 0).all() == (name in there)
    car = bpy.data.objects["car 1"]
    instances = bpy.context.evaluated_depsgraph_get().object_instances
    assert car in [instance.object.original for instance in instances]
    car.hide_viewport = True
    bpy.context.view_layer.update()
    assert car not in [i.object.original for i in bpy.context.evaluated_depsgraph_get().object_instances]


def test_hidden_vehicle_is_not_rendered(bpy: Any, traffic: Path, tmp_path: Path) -> None:
    obj = imported(bpy, traffic, set_up_scene=True)
    go_to(bpy, 3)
    bpy.context.scene.render.resolution_percentage = 30
    obj.hide_render = True
    whole = render(bpy, tmp_path / "whole.png")
    for name in CARS:
        bpy.data.objects[name].hide_render = True
    empty = render(bpy, tmp_path / "empty.png")
    assert np.ptp(empty[..., :3], axis=(0, 1)).max() < 0.01
    assert (np.abs(whole - empty)[..., :3] > 0.05).any(axis=2).sum() > 20


@pytest.mark.parametrize("carrier", ["ANCHORS", "GAUSSIANS"])
def test_bake_of_vehicles_equals_live(bpy: Any, traffic: Path, carrier: str) -> None:
    obj = imported(bpy, traffic, carrier=carrier)
    live = {}
    for frame in range(1, FRAMES + 1):
        go_to(bpy, frame)
        live[frame] = [played(bpy, part) for part in members(bpy, obj)]
    bpy.context.view_layer.objects.active = bpy.data.objects["car 2"]  # a part stands for its whole import
    assert bpy.ops.aa4d.bake() == {"FINISHED"}
    assert {part.aa4d.playback for part in members(bpy, obj)} == {"BAKED"}
    for frame in range(1, FRAMES + 1):
        go_to(bpy, frame)
        for part, expected in zip(members(bpy, obj), live[frame], strict=True):
            baked = played(bpy, part)
            np.testing.assert_allclose(baked["position"], expected["position"], atol=1e-4)
            np.testing.assert_allclose(baked["aa_opacity"], expected["aa_opacity"], atol=1.01 / 255)
            np.testing.assert_allclose(baked["aa_radius"], expected["aa_radius"], atol=1e-4)
    go_to(bpy, 3.25)
    for part, low, high in zip(members(bpy, obj), live[3], live[4], strict=True):
        between = 0.75 * low["position"] + 0.25 * high["position"]
        np.testing.assert_allclose(played(bpy, part)["position"], between, atol=1e-4)
    assert bpy.ops.aa4d.free_bake() == {"FINISHED"}
    go_to(bpy, 4)
    for part, expected in zip(members(bpy, obj), live[4], strict=True):
        np.testing.assert_allclose(played(bpy, part)["position"], expected["position"], atol=1e-6)


def test_bake_says_how_far_vehicles_leave_their_path(bpy: Any, extension: str, traffic: Path) -> None:
    """Against the exact places half way between the keys, by the specification, without what the field adds."""
    obj = imported(bpy, traffic)
    bake = importlib.import_module(f"{extension}.bake")
    tensors, information = a_model()
    for name in tensors:
        if name.startswith("head_position.output"):
            tensors[name][:] = 0
    still = write_model(traffic.parent / "still.safetensors", tensors, information)
    assert bpy.ops.aa4d.relink(filepath=str(still)) == {"FINISHED"}
    expected = 0.0
    for rank in range(FRAMES - 1):
        low, middle, high = (
            evaluate(tensors, information, (rank + f) / (FRAMES - 1), np.zeros(3))["anchors"] for f in (0, 0.5, 1)
        )
        there = np.array([True, rank in (1, 2), rank >= 2, True])[tensors["anchors.group"].astype(int)]
        there |= (tensors["anchors.group"] == 1) & np.isin(rank, (1, 2))
        error = np.linalg.norm(middle - (low + high) / 2, axis=1)[(tensors["anchors.group"] >= 0) & there]
        expected = max(expected, error.max())
    assert bake.largest_error_m(obj, bake.BakeOptions()) == pytest.approx(expected, rel=1e-3)
    finer = bake.largest_error_m(obj, bake.BakeOptions(step=0.25))
    assert 0 < finer < expected / 8


@pytest.mark.parametrize("baked", [False, True])
def test_vehicles_keep_the_time_of_the_world(bpy: Any, extension: str, traffic: Path, baked: bool) -> None:
    """Start, speed, direction and a keyed time of the lead drive the others, in a bake without this add-on too."""
    obj = imported(bpy, traffic)
    expected = {}
    for rank in (1, 3):
        go_to(bpy, rank + 1)
        expected[rank] = [attribute(part.data, "position") for part in members(bpy, obj)]
    if baked:
        assert bpy.ops.aa4d.bake() == {"FINISHED"}
    set_input(extension, obj, TIME, "Start Frame", 10.0)
    set_input(extension, obj, TIME, "Reverse", True)
    set_input(extension, obj, TIME, "Outside the Clip", "Loop")
    for frame, rank in ((11, 3), (13, 1), (18, 1)):
        go_to(bpy, frame)
        for part, positions in zip(members(bpy, obj), expected[rank], strict=True):
            np.testing.assert_allclose(played(bpy, part)["position"], positions, atol=2e-4)
    set_input(extension, obj, TIME, "Reverse", False)
    set_input(extension, obj, TIME, "Set Time by Hand", True)
    for frame, time in ((1, 1.0), (11, 5.0)):
        set_input(extension, obj, TIME, "Time", time)
        obj.keyframe_insert(input_path(extension, obj, TIME, "Time"), frame=frame)
    for point in obj.animation_data.action.layers[0].strips[0].channelbags[0].fcurves[0].keyframe_points:
        point.interpolation = "LINEAR"
    go_to(bpy, 8.5)
    for part, positions in zip(members(bpy, obj), expected[3], strict=True):
        np.testing.assert_allclose(played(bpy, part)["position"], positions, atol=2e-4)


def test_handles_ride_with_the_vehicles(bpy: Any, traffic: Path) -> None:
    """A lamp on a handle stays where it is on the car: what is at rest in the group's frame moves with the handle."""
    tensors, information = a_model()
    for name in tensors:
        if name.startswith("head_position.output"):
            tensors[name][:] = 0
    imported(bpy, write_model(traffic, tensors, information))
    for name in CARS:
        car, handle = bpy.data.objects[name], bpy.data.objects[f"{name} Handle"]
        local = 12 * tensors["anchors.position"][attribute(car.data, "aa_id")]
        for frame in range(1, FRAMES + 1):
            go_to(bpy, frame)
            matrix = np.array(handle.evaluated_get(bpy.context.evaluated_depsgraph_get()).matrix_world)
            np.testing.assert_allclose(
                attribute(car.data, "position"), local @ matrix[:3, :3].T + matrix[:3, 3], atol=1e-3
            )


def test_baked_vehicles_need_neither_add_on_nor_model(bpy: Any, extension: str, traffic: Path, tmp_path: Path) -> None:
    imported(bpy, traffic, bake=True)
    blend = tmp_path / "baked.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    traffic.unlink()
    bpy.ops.preferences.addon_disable(module=extension)
    try:
        bpy.ops.wm.open_mainfile(filepath=str(blend))
        for frame in (3, 4):
            go_to(bpy, frame)
            for name in CARS:
                cloud = drawn(bpy, bpy.data.objects[name])
                np.testing.assert_allclose(cloud["position"], expected_at(frame)["anchors"][cloud["aa_id"]], atol=1e-3)
    finally:
        bpy.ops.preferences.addon_enable(module=extension)


def test_vehicle_is_painted_and_the_look_goes_to_all(bpy: Any, extension: str, traffic: Path) -> None:
    obj = imported(bpy, traffic)
    car, other = bpy.data.objects["car 1"], bpy.data.objects["car 2"]
    go_to(bpy, 3)
    trained = drawn(bpy, car)["aa_color"]
    set_input(extension, car, LOOK, "Paint", (0.0, 0.0, 1.0, 1.0))
    set_input(extension, car, LOOK, "Paint Strength", 1.0)
    painted = drawn(bpy, car)["aa_color"]
    assert (painted[:, 2] >= painted[:, 0] - 1e-5).all()
    np.testing.assert_allclose(painted[:, :3].max(axis=1), trained[:, :3].max(axis=1), atol=1e-4)
    np.testing.assert_array_equal(drawn(bpy, other)["aa_color"], played(bpy, other)["aa_color"])
    other.modifiers[LOOK].show_viewport = True
    set_input(extension, car, LOOK, "Colour By", "Vehicle")
    set_input(extension, car, LOOK, "Paint Strength", 0.0)
    bpy.context.view_layer.objects.active = car
    assert bpy.ops.aa4d.match_parts() == {"FINISHED"}
    bpy.context.view_layer.update()
    colors = [np.unique(drawn(bpy, part)["aa_color"].round(4), axis=0) for part in members(bpy, obj)]
    assert [len(color) for color in colors] == [1, 1, 1, 1]
    assert len(np.unique(np.concatenate(colors), axis=0)) == 4
    np.testing.assert_allclose(colors[0][0, :3], 0.2, atol=1e-4)


@pytest.mark.parametrize("baked", [False, True])
def test_trail_follows_the_vehicle(bpy: Any, extension: str, traffic: Path, baked: bool) -> None:
    imported(bpy, traffic)
    car = bpy.data.objects["car 1"]
    if baked:
        assert bpy.ops.aa4d.bake() == {"FINISHED"}
    set_input(extension, car, LOOK, "Minimum Opacity", 0.0)
    set_input(extension, car, LOOK, "Ghost Distance", 0.0)
    set_input(extension, car, TIME, "Trail", 3)
    go_to(bpy, 5)
    ids = attribute(car.data, "aa_id")
    expected = np.concatenate([expected_at(frame)["anchors"][ids] for frame in (5, 4, 3, 2)])
    cloud = drawn(bpy, car)
    np.testing.assert_allclose(np.sort(cloud["position"], axis=0), np.sort(expected, axis=0), atol=1e-3)


def test_deleted_or_orphaned_parts_leave_the_rest_alone(bpy: Any, extension: str, traffic: Path, capfd: Any) -> None:
    obj = imported(bpy, traffic)
    set_input(extension, obj, TIME, "Start Frame", 3.0)
    bpy.data.objects.remove(bpy.data.objects["car 2"])
    go_to(bpy, 4)
    car = bpy.data.objects["car 3"]
    bpy.data.objects.remove(obj)
    capfd.readouterr()
    for frame in (4, 5):  # of which the clip shows the second and third
        go_to(bpy, frame)
        places = expected_at(frame - 2)["anchors"][attribute(car.data, "aa_id")]
        np.testing.assert_allclose(attribute(car.data, "position"), places, atol=1e-3)
    car.select_set(True)
    bpy.context.view_layer.objects.active = car
    assert bpy.ops.aa4d.bake() == {"FINISHED"}
    assert bpy.data.objects["car 1"].aa4d.playback == "LIVE"
    go_to(bpy, 7)
    np.testing.assert_allclose(
        played(bpy, car)["position"], expected_at(5)["anchors"][attribute(car.data, "aa_id")], atol=1e-3
    )
    assert "Traceback" not in "".join(capfd.readouterr())


def test_missing_model_is_said_once_for_all_vehicles(bpy: Any, traffic: Path, capfd: Any) -> None:
    imported(bpy, traffic)
    traffic.unlink()
    capfd.readouterr()
    go_to(bpy, 3)
    go_to(bpy, 4)
    assert "".join(capfd.readouterr()).count("cannot be read") == 1


def test_changed_file_is_relinked_for_all_vehicles(bpy: Any, traffic: Path, capfd: Any) -> None:
    obj = imported(bpy, traffic)
    tensors, information = a_model()
    tensors["groups.position"] += 0.2
    tensors["anchors.group"] = np.where(tensors["anchors.group"] == 0, 1, tensors["anchors.group"])
    write_model(traffic, tensors, information)
    capfd.readouterr()
    go_to(bpy, 3)
    assert "".join(capfd.readouterr()).count("is no longer the file that crossing was made from") == 1
    assert bpy.ops.aa4d.relink(filepath=str(traffic)) == {"FINISHED"}
    go_to(bpy, 4)
    expected = evaluate(tensors, information, 3 / (FRAMES - 1), np.zeros(3))["anchors"]
    for part in members(bpy, obj):
        ids = attribute(part.data, "aa_id")
        np.testing.assert_allclose(attribute(part.data, "position"), expected[ids], atol=1e-3)
    assert (attribute(bpy.data.objects["car 1"].data, "aa_group") == 1).all()


def test_splats_go_out_with_the_vehicles_that_are_shown(bpy: Any, traffic: Path, tmp_path: Path) -> None:
    obj = imported(bpy, traffic, carrier="GAUSSIANS")
    go_to(bpy, 3)
    bpy.data.objects["car 2"].hide_viewport = True
    bpy.data.objects["car 3"].location = (0, 0, 5)
    bpy.context.view_layer.update()

    def count(path: Path) -> int:
        header = path.read_bytes().split(b"end_header")[0].decode()
        return int(next(line.split()[-1] for line in header.splitlines() if line.startswith("element vertex")))

    def seen(name: str) -> int:
        part = obj if name == "world" else bpy.data.objects[name]
        return int((attribute(part.data, "aa_opacity") >= 0.05).sum())

    assert bpy.ops.aa4d.export_ply(filepath=str(tmp_path / "all.ply")) == {"FINISHED"}
    assert count(tmp_path / "all.ply") == seen("world") + seen("car 1") + seen("car 3")
    rows = np.frombuffer((tmp_path / "all.ply").read_bytes().split(b"end_header\n")[1], "<f4").reshape(-1, 17)
    car = bpy.data.objects["car 3"]
    opaque = attribute(car.data, "aa_opacity") >= 0.05
    np.testing.assert_allclose(
        rows[-seen("car 3") :, :3], attribute(car.data, "position")[opaque] + [0, 0, 5], atol=1e-4
    )
    bpy.context.view_layer.objects.active = bpy.data.objects["car 1"]
    assert bpy.ops.aa4d.export_ply(filepath=str(tmp_path / "car.ply")) == {"FINISHED"}
    assert count(tmp_path / "car.ply") == seen("car 1")
    bpy.context.view_layer.objects.active = obj
    assert bpy.ops.aa4d.export_usd(filepath=str(tmp_path / "all.usdc"), use_range=True) == {"FINISHED"}
    assert bpy.context.active_object == obj


def test_compositing_takes_the_vehicles_along(bpy: Any, extension: str, traffic: Path) -> None:
    obj = imported(bpy, traffic)
    assert bpy.ops.aa4d.set_up_compositing(mode="PLATE") == {"FINISHED"}
    modifiers = importlib.import_module(f"{extension}.modifiers")
    for part in members(bpy, obj):
        assert part.is_holdout
        assert not part.visible_shadow
        assert modifiers.get(part.modifiers[LOOK], "Crop") == "Inside"
    assert len([o for o in bpy.data.objects if o.name.endswith(("Ground", "Occluders"))]) == 2


def test_activity_of_a_vehicle_is_what_shows_it(bpy: Any, tmp_path: Path) -> None:
    """Frames that do not show the second car say "static" where it would be; those that do say "persistent"."""
    from PIL import Image

    capture = tmp_path / "capture"
    (capture / "truth" / "activity").mkdir(parents=True)
    (capture / "capture.json").write_text(json.dumps({"format": "aa4d-capture"}))
    tensors, information = a_model()
    tensors["anchors.position"][:, 2] *= 0.1
    information["capture"] = "capture"
    for rank, frame in enumerate(information["frames"]):
        frame["viewmat"] = [[1, 0, 0, -30], [0, -1, 0, -20], [0, 0, -1, 90], [0, 0, 0, 1]]  # from straight above
        labels = np.full((180, 320), 2 if rank == 2 else 0, np.uint8)
        Image.fromarray(labels).save(capture / "truth" / "activity" / f"{frame['name']}.png")
    tensors["groups.shown"][1] = (0.4, 0.45, 0.55, 0.6)  # the middle frame alone
    imported(bpy, write_model(tmp_path / "model.safetensors", tensors, information))
    assert bpy.ops.aa4d.label_activity() == {"FINISHED"}
    assert (attribute(bpy.data.objects["car 2"].data, "aa_activity") == 2).all()
    assert (attribute(bpy.data.objects["car 1"].data, "aa_activity") == 0).all()


def test_vehicles_panel_hides(bpy: Any, extension: str, traffic: Path) -> None:
    panel = importlib.import_module(f"{extension}.panel")
    imported(bpy, traffic)
    assert panel.VehiclesPanel.poll(bpy.context)
    layout = MagicMock()
    layout.column.return_value = layout.row.return_value = layout
    panel.VehiclesPanel.draw(SimpleNamespace(layout=layout), bpy.context)
    shown = [call.args for call in layout.prop.call_args_list]
    assert [part.name for part, path in shown if path == "hide_render"] == list(CARS)
    for part, path in shown:
        assert getattr(part, path) in (part.name, False)
    panel.ImportPanel.draw(SimpleNamespace(layout=layout), bpy.context)
    assert "3 vehicles" in [call.kwargs.get("text") for call in layout.label.call_args_list]


def test_names_that_blender_cannot_show(bpy: Any, traffic: Path) -> None:
    tensors, information = a_model()
    for group, name in zip(information["groups"], ("", "bus\n\x00" + "é" * 150, "ü 🚗 3"), strict=True):
        group["name"] = name
    obj = imported(bpy, write_model(traffic, tensors, information))
    names = [child.name for child in obj.children if child.type == "MESH"]
    assert "Vehicle 1" in names
    assert "ü 🚗 3" in names
    assert [name for name in names if name.startswith("busé")]


def test_group_whose_anchors_are_gone_becomes_nothing(bpy: Any, traffic: Path) -> None:
    tensors, information = a_model()
    tensors["anchors.group"][tensors["anchors.group"] == 1] = -1
    imported(bpy, write_model(traffic, tensors, information))
    assert "car 2" not in bpy.data.objects
    assert "car 3" in bpy.data.objects


def test_more_vehicles_than_blender_should_show_are_refused(bpy: Any, traffic: Path) -> None:
    write_model(traffic, *make_model(1400, FRAMES, groups=1040))
    with pytest.raises(RuntimeError, match="1,040 vehicles, more than the 1,000"):
        bpy.ops.aa4d.import_model(filepath=str(traffic))
    assert not bpy.data.objects
    assert not bpy.data.collections
    imported(bpy, traffic, vehicles=False)


def test_undo_of_an_import_leaves_nothing(bpy: Any, traffic: Path) -> None:
    bpy.ops.ed.undo_push(message="before")
    done = bpy.ops.aa4d.import_model("EXEC_DEFAULT", True, filepath=str(traffic), carrier="ANCHORS")
    assert done == {"FINISHED"}
    bpy.ops.ed.undo()
    assert not bpy.data.objects
    bpy.ops.ed.redo()
    go_to(bpy, 4)
    car = bpy.data.objects["car 1"]
    places = expected_at(4)["anchors"][attribute(car.data, "aa_id")]
    np.testing.assert_allclose(attribute(car.data, "position"), places, atol=1e-3)
