"""Out again: what the object shows, as 3DGS PLY files or as animated USD points."""

import errno
import math
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np

from . import modifiers, names, parts, points, snapshot, splat_ply, time_nodes, usd_file
from .node_tree import Tree, versioned_group

NOTHING_SHOWN = "Nothing is shown: the filters and the crop let no point through."
USD_KEYS = (names.POSITION, names.COLOR, names.OPACITY, names.RADIUS)


def export_ply(obj: bpy.types.Object, context: bpy.types.Context, path: Path, frames: Sequence[int]) -> list[Path]:
    """Write one PLY for each frame of the timeline; with several frames the number is added to the name.

    What is drawn goes out: where the objects stand in the world, as filtered, cropped, sized and coloured. With a lead
    go those of its vehicles that are shown.

    Raises:
        OSError: a file cannot be written, or nothing is shown.
    """
    written = []
    with _bare(obj, context.scene) as objects:
        for frame in frames:
            context.scene.frame_set(frame)
            now = snapshot.take(objects, context.evaluated_depsgraph_get())
            seen = now.seen
            if not seen.any() and len(frames) == 1:
                raise OSError(NOTHING_SHOWN)
            target = path if len(frames) == 1 else path.with_name(f"{path.stem}_{frame:04}{path.suffix}")
            colors = splat_ply.srgb(now.colors[seen, :3])
            splat_ply.write_ply(
                target, now.positions[seen], colors, now.opacity[seen], now.scales[seen], now.rotations[seen]
            )
            written.append(target)
    return written


def has_usd() -> bool:
    """Whether this Blender was built with USD: that is a choice of who builds it."""
    return bool(bpy.app.build_options.usd)


def export_usd(obj: bpy.types.Object, context: bpy.types.Context, path: Path, frames: Sequence[int]) -> None:
    """Write the points of these consecutive frames as UsdGeomPoints with time samples: positions, widths, and the
    colour and opacity as primvars.

    Blender's exporter takes animated points from a point cloud object alone: one is made of baked keys, exported, and
    removed.

    Raises:
        OSError: the file cannot be written, or nothing is shown.
    """
    scene = context.scene
    with _bare(obj, scene) as objects:
        moments = []
        for frame in frames:
            scene.frame_set(frame)
            moments.append(snapshot.take(objects, context.evaluated_depsgraph_get()))
    seen = np.any([moment.seen for moment in moments], axis=0)
    if not seen.any():
        raise OSError(NOTHING_SHOWN)
    cloud = _cloud(obj, context, moments, seen, frames[0])
    partial = path.with_name(f".{path.stem}.part{path.suffix}")  # what a killed process left is written over
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
        if not partial.is_file() or not usd_file.is_whole(partial):
            raise OSError(errno.ENOSPC, "could not be written whole; free some space and export again", str(path))
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
        radius = np.where(moment.seen, moment.radius, 0)  # what comes and goes stays a point: all moments have the same
        values = {names.POSITION: moment.positions, names.RADIUS: radius, names.COLOR: moment.colors.copy()}
        values[names.COLOR][:, 3] = moment.opacity
        for key in names.keys_of(values):
            points.write(mesh, names.key_name(key, number), key.type, values[key.attribute][seen])
    points.write(mesh, names.POSITION.name, names.POSITION.type, moments[0].positions[seen])
    cloud = bpy.data.objects.new(obj.name, mesh)
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
    """What is shown of the object, and with it, as bare points; the timeline is back where it was afterwards.

    Raises:
        OSError: nothing of it is shown.
    """
    objects = parts.shown_with(obj)
    if not objects:
        raise OSError(f"{obj.name} is hidden; what is shown is exported.")
    frame = scene.frame_current_final
    try:
        with snapshot.stand_ins(objects, scene) as copies:
            yield copies
    finally:
        scene.frame_set(math.floor(frame), subframe=frame % 1)
