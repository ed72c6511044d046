"""Out again from the packaged extension: splats and USD points."""

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driving import attribute, clip_positions, drawn, go_to, imported, played, read_ply, set_input, srgb
from model_files import make_model, write_model

FRAMES = 5
LOOK = "AdaAnchor4D"


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


def world_of(ply: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Places [n, 3] and covariances [n, 3, 3]."""
    from mathutils import Quaternion

    scales = np.exp(np.stack([ply[f"scale_{i}"] for i in range(3)], 1)).astype(np.float64)
    quaternions = np.stack([ply[f"rot_{i}"] for i in range(4)], 1)
    axes = np.array([Quaternion(quaternion).to_matrix() for quaternion in quaternions]) * scales[:, None]
    return np.stack([ply[a] for a in "xyz"], 1), axes @ axes.transpose(0, 2, 1)


def drawn_gaussians(bpy: Any, *objects: Any) -> tuple[np.ndarray, np.ndarray]:
    """What Blender draws: places [n, 3] and covariances [n, 3, 3] of the ellipsoids of these objects."""
    every = bpy.context.evaluated_depsgraph_get().object_instances
    matrices = [np.array(i.matrix_world, np.float64) for i in every if i.is_instance and i.parent.original in objects]
    linear = np.array(matrices).reshape(-1, 4, 4)[:, :3, :3]
    return np.array(matrices).reshape(-1, 4, 4)[:, :3, 3], linear @ linear.transpose(0, 2, 1)


def assert_same_splats(found: tuple[np.ndarray, np.ndarray], expected: tuple[np.ndarray, np.ndarray]) -> None:
    assert len(found[0]) == len(expected[0]) > 5
    orders = [np.lexsort(places.round(2).T) for places, _ in (found, expected)]
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one[orders[0]], other[orders[1]], atol=3e-3)


@pytest.mark.parametrize("baked", [False, True])
@pytest.mark.parametrize(
    ("moved", "groups"), [("", 0), ("turned and grown", 3), ("stretched", 0), ("mirrored", 3), ("in motion", 3)]
)
def test_splats_stand_where_they_are_drawn(
    bpy: Any, extension: str, tmp_path: Path, baked: bool, moved: str, groups: int
) -> None:
    """With the object's transform, its crop, its filters and its size, as instances in Blender's own words."""
    from mathutils import Vector

    path = write_model(tmp_path / "model.safetensors", *make_model(60, FRAMES, groups=groups))
    obj = imported(bpy, path, carrier="GAUSSIANS", look="Gaussians", bake=baked)
    objects = [obj, *(bpy.data.objects[f"car {number + 1}"] for number in range(groups))]
    if moved:
        obj.location, obj.rotation_euler = (10, -5, 3), (0.2, 0.4, 1)
        obj.scale = {"stretched": (1, 2, 0.5), "mirrored": (-1, 1, 1)}.get(moved, (2, 2, 2))
    if moved == "in motion":
        obj.keyframe_insert("location", frame=1)
        obj.location.x += 20
        obj.keyframe_insert("location", frame=5)
    box = bpy.data.objects.new("box", None)
    bpy.context.collection.objects.link(box)
    go_to(bpy, 4)
    box.location, box.scale = obj.matrix_world @ Vector((30, -20, 4)), (15, 14, 30)
    bpy.context.view_layer.update()
    for part in objects:
        for name, value in (("Crop", "Inside"), ("Crop Object", box), ("Size", 1.5), ("Minimum Opacity", 0.1)):
            set_input(extension, part, LOOK, name, value)
    go_to(bpy, 4)
    expected = drawn_gaussians(bpy, *objects)
    assert bpy.ops.aa4d.export_ply(filepath=str(tmp_path / "now.ply")) == {"FINISHED"}
    assert_same_splats(world_of(read_ply(tmp_path / "now.ply")), expected)
    assert_same_splats(drawn_gaussians(bpy, *objects), expected)  # nothing has changed in Blender
    assert {o.name for o in bpy.data.objects if o.type == "MESH"} == {o.name for o in objects}


def test_splats_have_the_colours_that_are_drawn(bpy: Any, extension: str, model_path: Path, tmp_path: Path) -> None:
    """Painted, or showing a quantity."""
    obj = imported(bpy, model_path, carrier="GAUSSIANS", look="Points")
    for name, value in (("Minimum Opacity", 0.0), ("Paint", (0, 0, 1, 1)), ("Paint Strength", 1.0)):
        set_input(extension, obj, LOOK, name, value)
    for color_by in ("Trained Colour", "Opacity"):
        set_input(extension, obj, LOOK, "Colour By", color_by)
        written = attribute(obj.data, "aa_opacity") >= 1 / 255  # splats that no rasteriser draws are left out
        expected = srgb(drawn(bpy, obj)["aa_color"][written, :3])
        assert bpy.ops.aa4d.export_ply(filepath=str(tmp_path / "now.ply")) == {"FINISHED"}
        ply = read_ply(tmp_path / "now.ply")
        color = 0.5 + 0.28209479177387814 * np.stack([ply[f"f_dc_{i}"] for i in range(3)], 1)
        np.testing.assert_allclose(color, expected, atol=1e-3)
        assert np.abs(expected - srgb(attribute(obj.data, "aa_color")[written, :3])).max() > 0.1


def test_nothing_shown_is_said(bpy: Any, extension: str, model_path: Path, tmp_path: Path) -> None:
    obj = imported(bpy, model_path)
    exports = (bpy.ops.aa4d.export_ply, "now.ply"), (bpy.ops.aa4d.export_usd, "now.usdc")
    set_input(extension, obj, LOOK, "Moved at Least", 1e5)
    for export, name in exports:
        with pytest.raises(RuntimeError, match="let no point through"):
            export(filepath=str(tmp_path / name))
    set_input(extension, obj, LOOK, "Moved at Least", 0.0)
    obj.hide_set(True)
    for export, name in exports:
        with pytest.raises(RuntimeError, match="is hidden"):
            export(filepath=str(tmp_path / name))
    obj.hide_set(False)
    obj.modifiers.new("person's own", "NODES").node_group = bpy.data.node_groups.new("empty", "GeometryNodeTree")
    for export, name in exports:
        with pytest.raises(RuntimeError, match="after its modifiers"):
            export(filepath=str(tmp_path / name))
    assert not list(tmp_path.glob("now*"))
    assert [o for o in bpy.data.objects if o.type == "MESH"] == [obj]


def test_usd_points_move_with_the_object_and_its_crop(
    bpy: Any, extension: str, model_path: Path, tmp_path: Path
) -> None:
    obj = imported(bpy, model_path)
    obj.rotation_euler, obj.scale = (0, 0, 1), (2, 2, 2)
    obj.keyframe_insert("location", frame=1)
    obj.location.x += 40
    obj.keyframe_insert("location", frame=5)
    set_input(extension, obj, LOOK, "Moved at Least", 1.5)
    expected = {}
    for frame in (1, 4):
        go_to(bpy, frame)
        cloud, matrix = drawn(bpy, obj), np.array(obj.matrix_world)
        places = cloud["position"] @ matrix[:3, :3].T + matrix[:3, 3]
        expected[frame] = places[cloud["radius"] > 0], 2 * cloud["radius"][cloud["radius"] > 0]
    path = tmp_path / "points.usdc"
    assert bpy.ops.aa4d.export_usd(filepath=str(path), use_range=True) == {"FINISHED"}
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.wm.usd_import(filepath=str(path))
    cloud = next(o for o in bpy.data.objects if o.type == "POINTCLOUD")
    for frame, (places, radii) in expected.items():
        go_to(bpy, frame)
        data = cloud.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        matrix = np.array(cloud.matrix_world)
        found, radius = attribute(data, "position") @ matrix[:3, :3].T + matrix[:3, 3], attribute(data, "radius")
        np.testing.assert_allclose(found[radius > 0], places, atol=2e-3)
        np.testing.assert_allclose(radius[radius > 0], radii, rtol=1e-3)


def test_blender_without_usd_says_so(
    bpy: Any, extension: str, model_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    imported(bpy, model_path)
    assert bpy.ops.aa4d.export_usd.poll()
    monkeypatch.setattr(importlib.import_module(f"{extension}.exporter"), "has_usd", lambda: False)
    assert not bpy.ops.aa4d.export_usd.poll()
    with pytest.raises(RuntimeError, match="built without USD"):
        bpy.ops.aa4d.export_usd(filepath=str(tmp_path / "points.usdc"))
    assert bpy.ops.aa4d.export_ply.poll()
