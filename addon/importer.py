"""Importing a model file: the plain function behind the operator."""

import os
from dataclasses import dataclass

import bpy

from . import carriers, materials, names, nodes, playback, points
from .camera import create_camera
from .model import Model
from .scene import set_timeline, set_up_scene


@dataclass(frozen=True)
class ImportOptions:
    """What to make of a model file; see docs/addon.md."""

    carrier: str = names.ANCHORS
    import_camera: bool = True
    set_timeline: bool = True
    set_up_scene: bool = False


@dataclass(frozen=True)
class Imported:
    """What an import made."""

    model: Model
    points: bpy.types.Object
    camera: bpy.types.Object | None


def import_model(
    path: str, scene: bpy.types.Scene, collection: bpy.types.Collection, options: ImportOptions
) -> Imported:
    """Make an object of points that follows the timeline, in world metres, and the capture's camera.

    Raises:
        ModelFileError: the file is unusable; nothing was made.
    """
    path = os.path.abspath(bpy.path.abspath(path))
    field = playback.load_field(path)
    model = field.model
    name = os.path.basename(os.path.dirname(path)) or "AdaAnchor4D"
    mesh = points.create_mesh(name, carriers.point_count(field, options.carrier), options.carrier)
    obj = bpy.data.objects.new(name, mesh)
    obj.aa4d.filepath = _stored_path(path)
    obj.aa4d.carrier = options.carrier
    if options.carrier == names.GAUSSIANS:
        group = nodes.gaussians_group(materials.gaussians_material())
    else:
        group = nodes.points_group(materials.points_material())
    nodes.add_modifier(obj, names.LOOK_MODIFIER, group)
    collection.objects.link(obj)
    camera = create_camera(model, f"{name} Camera") if options.import_camera else None
    if camera is not None:
        collection.objects.link(camera)
    if options.set_timeline:
        set_timeline(scene, model)
        scene.frame_set(min(max(scene.frame_current, scene.frame_start), scene.frame_end))
    if options.set_up_scene:
        set_up_scene(scene, camera, model)
    playback.show(obj, scene.frame_current_final)
    return Imported(model, obj, camera)


def _stored_path(path: str) -> str:
    """Relative to the .blend where that is possible, so that the two can be moved together."""
    if not bpy.data.filepath:
        return path
    try:
        return bpy.path.relpath(path)
    except ValueError:  # another drive
        return path
