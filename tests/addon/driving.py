"""Driving the packaged extension: what the tests share."""

import importlib
from pathlib import Path
from typing import Any

import numpy as np

WIDTHS = {
    "FLOAT": ("value", 1),
    "INT": ("value", 1),
    "FLOAT_VECTOR": ("vector", 3),
    "FLOAT_COLOR": ("color", 4),
    "QUATERNION": ("value", 4),
}


def imported(bpy: Any, path: Path, **options: Any) -> Any:
    """Import through the operator, the anchors unless told otherwise; the new points, active."""
    options = {"carrier": "ANCHORS", **options}
    assert bpy.ops.aa4d.import_model(filepath=str(path), **options) == {"FINISHED"}
    return bpy.context.active_object


def set_input(extension: str, obj: Any, modifier: str, name: str, value: Any) -> None:
    """Set an input of one of the object's modifiers, and let Blender know, as its interface does."""
    import bpy

    importlib.import_module(f"{extension}.modifiers").put(obj.modifiers[modifier], name, value)
    obj.update_tag()
    bpy.context.view_layer.update()


def input_path(extension: str, obj: Any, modifier: str, name: str) -> str:
    """The path, from the object, by which an input is keyed and driven."""
    owner, path = importlib.import_module(f"{extension}.modifiers").property_of(obj.modifiers[modifier], name)
    if path == "value":
        return f"{owner.path_from_id()}.value"
    return f'modifiers["{modifier}"]{path}'


def go_to(bpy: Any, frame: float) -> None:
    bpy.context.scene.frame_set(int(frame // 1), subframe=frame % 1)


def clip_positions(bpy: Any, obj: Any, ranks: list[float]) -> np.ndarray:
    """The positions of a live object at ranks of the clip, before its time was changed."""
    result = []
    for rank in ranks:
        go_to(bpy, rank + 1)
        result.append(attribute(obj.data, "position"))
    return np.array(result)


def attribute(data: Any, name: str) -> np.ndarray:
    layer = data.attributes[name]
    field, width = WIDTHS[layer.data_type]
    values = np.empty(len(layer.data) * width, np.int32 if layer.data_type == "INT" else np.float32)
    layer.data.foreach_get(field, values)
    return values.reshape(-1, width) if width > 1 else values


def played(bpy: Any, obj: Any) -> dict[str, np.ndarray]:
    """What the timeline makes of the points, baked or live, before the look turns them into something to draw."""
    obj.modifiers["AdaAnchor4D"].show_viewport = False
    data = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    names = ("position", "aa_color", "aa_opacity", "aa_radius", "aa_scale", "aa_rotation")
    return {name: attribute(data, name) for name in names if name in data.attributes}


def drawn(bpy: Any, obj: Any) -> dict[str, np.ndarray]:
    """The point cloud that the look draws."""
    geometry = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).evaluated_geometry()
    cloud = geometry.pointcloud
    names = ("position", "radius", "aa_color", "aa_id")
    return {name: attribute(cloud, name) for name in names}


def splats_of(bpy: Any, obj: Any) -> dict[str, np.ndarray]:
    """The splats that the look makes of the points: every attribute."""
    geometry = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).evaluated_geometry()
    cloud = geometry.pointcloud
    assert cloud.type == "GAUSSIAN_SPLAT"
    return {a.name: attribute(cloud, a.name) for a in cloud.attributes if a.data_type in WIDTHS}


def srgb(linear: np.ndarray) -> np.ndarray:
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)


def render(bpy: Any, path: Path, *, samples: int = 4) -> np.ndarray:
    """Render the scene with Cycles; [height, width, 4], as the file has it."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.max_bounces = samples, False, 2
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGBA"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(path))
    pixels = np.array(image.pixels[:], np.float32).reshape(image.size[1], image.size[0], 4)
    bpy.data.images.remove(image)
    return pixels


def read_ply(path: Path) -> dict[str, np.ndarray]:
    header, data = path.read_bytes().split(b"end_header\n", 1)
    names = [line.split()[2] for line in header.decode().splitlines() if line.startswith("property float")]
    rows = np.frombuffer(data, "<f4").reshape(-1, len(names))
    assert f"element vertex {len(rows)}" in header.decode()
    return dict(zip(names, rows.T, strict=True))
