"""Importing a model file: the plain function behind the operator."""

import os
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from . import (
    activity,
    bake,
    carriers,
    look_nodes,
    materials,
    modifiers,
    names,
    playback,
    points,
    properties,
    time_nodes,
)
from .camera import capture_folder, create_camera, show_frames
from .container import ModelFileError
from .model import Model
from .scene import set_timeline, set_up_scene


@dataclass(frozen=True)
class ImportOptions:
    """What to make of a model file; see docs/addon.md."""

    carrier: str = names.ANCHORS
    look: str = materials.POINTS
    view: str = properties.CAPTURE
    import_camera: bool = True
    background_frames: bool = True
    set_timeline: bool = True
    set_up_scene: bool = False
    largest: int = 2_000_000  # points


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
        ModelFileError: the file is unusable, or has more points than asked for; nothing was made.
    """
    path = _chosen(path)
    loaded = playback.load(path)
    model = loaded.field.model
    count = carriers.point_count(loaded.field, options.carrier)
    if count > options.largest:
        raise ModelFileError(
            f"{model.path.name} has {count:,} {options.carrier.lower()}, more than the {options.largest:,} allowed "
            "here; import the anchors, or allow more."
        )
    name = os.path.basename(os.path.dirname(path)) or "AdaAnchor4D"
    mesh = points.create_mesh(name, count)
    obj = bpy.data.objects.new(name, mesh)
    settings = obj.aa4d
    settings.filepath = playback.relative(path, os.path.dirname(bpy.data.filepath)) if bpy.data.filepath else path
    settings.last_place, settings.content = path, loaded.content
    settings.carrier, settings.view = options.carrier, options.view
    settings.frozen_view = model.camera_center_at(0.5)
    modifiers.put(bake.time_modifier(obj), time_nodes.CLIP_FRAMES, model.frame_count)
    look = obj.modifiers.new(names.LOOK_MODIFIER, "NODES")
    look.node_group = look_nodes.look_group()
    modifiers.put(look, look_nodes.LOOK, options.look)
    collection.objects.link(obj)
    try:
        playback.show(obj, scene)
    except BaseException:  # the model cannot be evaluated: as if it had not been read
        bpy.data.batch_remove([obj, mesh])
        raise
    camera = create_camera(model, f"{name} Camera") if options.import_camera else None
    if camera is not None:
        collection.objects.link(camera)
        if options.background_frames:
            show_frames(camera, model)
    if options.set_timeline:
        set_timeline(scene, model)
        scene.frame_set(min(max(scene.frame_current, scene.frame_start), scene.frame_end))
    if options.set_up_scene:
        set_up_scene(scene, camera, model)
    playback.show(obj, scene)
    return Imported(model, obj, camera)


def relink(obj: bpy.types.Object, path: str, scene: bpy.types.Scene) -> None:
    """Let an imported object show this file from now on.

    Raises:
        ModelFileError: the file is unusable, or has fewer points than the object shows; the object is left as it was.
    """
    path = _chosen(path)
    loaded = playback.load(path)
    playback.check_fits(obj, loaded)
    settings = obj.aa4d
    settings.filepath = playback.relative(path, os.path.dirname(bpy.data.filepath)) if bpy.data.filepath else path
    settings.last_place, settings.content = path, loaded.content
    modifiers.put(bake.time_modifier(obj), time_nodes.CLIP_FRAMES, loaded.field.model.frame_count)
    playback.problems.pop(obj.session_uid, None)
    if settings.playback == "LIVE":
        playback.show(obj, scene)


def _chosen(path: str) -> str:
    """The absolute path of the file that a person chose.

    Raises:
        ModelFileError: none was chosen.
    """
    if not path:
        raise ModelFileError("No file was chosen; choose the model.safetensors of a run.")
    return os.path.abspath(bpy.path.abspath(path))


def label_activity(obj: bpy.types.Object) -> dict[str, int]:
    """Write the activity at each point's anchor; how many points have which.

    Raises:
        ModelFileError: the model or its capture is not found, or knows no activity.
        RuntimeError: Blender cannot read one of the pictures.
    """
    loaded = playback.loaded_of(obj)
    playback.check_fits(obj, loaded)
    model = loaded.field.model
    folder = capture_folder(model)
    if folder is None:
        raise ModelFileError(f"The capture that {model.path.name} was trained on is not beside it.")
    labels = activity.label_anchors(model, folder, lambda rank: loaded.trail(names.ANCHORS, rank), _read_labels)
    rows = points.ids(obj.data) // carriers.points_per_anchor(loaded.field, obj.aa4d.carrier)
    points.write(obj.data, names.ACTIVITY.name, names.ACTIVITY.type, labels[rows])
    obj.data.update()
    known = ("not seen", *activity.LABELS)
    return {
        known[label + 1]: int(count) for label, count in zip(*np.unique(labels[rows], return_counts=True), strict=True)
    }


def _read_labels(path: Path) -> np.ndarray:
    """A picture of 8-bit labels [H, W], first row at the top."""
    image = bpy.data.images.load(str(path))
    try:
        image.colorspace_settings.name = "Non-Color"
        width, height = image.size
        pixels = np.empty(width * height * image.channels, np.float32)
        image.pixels.foreach_get(pixels)
        return np.round(255 * pixels.reshape(height, width, -1)[::-1, :, 0]).astype(np.uint8)
    finally:
        bpy.data.images.remove(image)
