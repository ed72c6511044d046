"""Out again: what the object shows, as 3DGS PLY files or as animated USD points."""

import math
import os
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

import bpy
import numpy as np

from . import look_nodes, materials, modifiers, names, parts, points, snapshot, splat_ply, time_nodes
from .node_tree import Tree, versioned_group

USD_KEYS = (names.POSITION, names.COLOR, names.OPACITY, names.RADIUS)


def export_ply(obj: bpy.types.Object, context: bpy.types.Context, path: Path, frames: Sequence[int]) -> list[Path]:
    """Write one PLY for each frame of the timeline; with several frames the number is added to the name.

    With a lead go those of its vehicles that are shown.

    Raises:
        OSError: a file cannot be written.
    """
    written = []
    with _bare(obj, context.scene) as objects:
        for frame in frames:
            context.scene.frame_set(frame)
            now = snapshot.take(objects, context.evaluated_depsgraph_get())
            seen = now.seen
            target = path if len(frames) == 1 else path.with_name(f"{path.stem}_{frame:04}{path.suffix}")
            colors = splat_ply.srgb(now.colors[seen, :3])
            splat_ply.write_ply(
                target, now.positions[seen], colors, now.opacity[seen], now.scales[seen], now.rotations[seen]
            )
            written.append(target)
    return written


def export_usd(obj: bpy.types.Object, context: bpy.types.Context, path: Path, frames: Sequence[int]) -> None:
    """Write the points of these consecutive frames as UsdGeomPoints with time samples: positions, widths, and the
    colour and opacity as primvars.

    Blender's exporter takes animated points from a point cloud object alone: one is made of baked keys, exported, and
    removed.

    Raises:
        OSError: the file cannot be written.
    """
    scene = context.scene
    with _bare(obj, scene) as objects:
        moments = []
        for frame in frames:
            scene.frame_set(frame)
            moments.append(snapshot.take(objects, context.evaluated_depsgraph_get()))
    seen = np.any([moment.seen for moment in moments], axis=0)
    cloud = _cloud(obj, context, moments, seen, frames[0])
    partial = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    kept = scene.frame_start, scene.frame_end
    try:
        scene.frame_start, scene.frame_end = frames[0], frames[-1]
        bpy.ops.wm.usd_export(
            filepath=str(partial),
            selected_objects_only=True,
            export_animation=len(frames) > 1,
            export_materials=False,
            evaluation_mode="VIEWPORT",
        )
        if not partial.is_file():
            raise OSError(f"{path} could not be written; Blender's console says why.")
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)
        scene.frame_start, scene.frame_end = kept
        data = cloud.data
        bpy.data.objects.remove(cloud)
        bpy.data.pointclouds.remove(data)


def _cloud(
    obj: bpy.types.Object,
    context: bpy.types.Context,
    moments: Sequence[snapshot.Snapshot],
    seen: np.ndarray,
    first_frame: int,
) -> bpy.types.Object:
    """A selected point cloud object that plays the moments from `first_frame` on."""
    mesh = points.create_mesh(obj.name, moments[0].ids[seen])
    for number, moment in enumerate(moments):
        values = {names.POSITION: moment.positions, names.RADIUS: moment.radius, names.COLOR: moment.colors.copy()}
        values[names.COLOR][:, 3] = moment.opacity
        for key in names.keys_of(values):
            points.write(mesh, names.key_name(key, number), key.type, values[key.attribute][seen])
    points.write(mesh, names.POSITION.name, names.POSITION.type, moments[0].positions[seen])
    cloud = bpy.data.objects.new(obj.name, mesh)
    cloud.matrix_world = obj.matrix_world
    context.collection.objects.link(cloud)
    for selected in context.selected_objects:
        selected.select_set(False)
    cloud.select_set(True)
    context.view_layer.objects.active = cloud
    bpy.ops.object.convert(target="POINTCLOUD")
    cloud = context.view_layer.objects.active
    if not mesh.users:
        bpy.data.meshes.remove(mesh)
    modifier = cloud.modifiers.new(names.TIME_MODIFIER, "NODES")
    modifier.node_group = time_nodes.baked_group(USD_KEYS)
    cloud.modifiers.new("Radius", "NODES").node_group = _radius_group()
    for name, value in (
        (time_nodes.START, float(first_frame)),
        (time_nodes.CLIP_FRAMES, len(moments)),
        (time_nodes.KEY_COUNT, len(moments)),
    ):
        modifiers.put(modifier, name, value)
    return cloud


def _radius_group() -> bpy.types.NodeTree:
    """Give a point cloud its own radius from ours."""
    group, made = versioned_group("AdaAnchor4D Radius", 1)
    if made:
        tree = Tree(group)
        inputs = {"Points": tree.input("Geometry"), "Radius": tree.named(names.RADIUS.name, names.RADIUS.type)}
        tree.finish(tree.node("GeometryNodeSetPointRadius", inputs).outputs[0])
    return group


@contextmanager
def _bare(obj: bpy.types.Object, scene: bpy.types.Scene) -> Iterator[list[bpy.types.Object]]:
    """The object, and what is shown with it, as points with their full shape and no look; the timeline is back where
    it was afterwards."""
    frame, objects = scene.frame_current_final, list(parts.shown_with(obj))
    try:
        with ExitStack() as stack:
            for part in objects:
                stack.enter_context(_with_shape(part))
            yield objects
    finally:
        scene.frame_set(math.floor(frame), subframe=frame % 1)


@contextmanager
def _with_shape(obj: bpy.types.Object) -> Iterator[None]:
    look = modifiers.of(obj, names.LOOK_MODIFIER)
    kind = modifiers.get(look, look_nodes.LOOK) if look is not None else None
    try:
        if look is not None and obj.aa4d.playback == "LIVE":
            modifiers.put(look, look_nodes.LOOK, materials.GAUSSIANS)  # so that shapes are evaluated
        with snapshot.without_look(obj):
            yield
    finally:
        if look is not None:
            modifiers.put(look, look_nodes.LOOK, kind)
