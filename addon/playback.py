"""Live playback: one handler evaluates every live object at the timeline's time."""

import functools
import os
import time

import bpy

from . import carriers, names, points
from .container import ModelFileError
from .field import Field, prepare
from .model import read_model

# For the panel: the cost of the last evaluation and the last problem, by the object's session id.
milliseconds: dict[int, float] = {}
problems: dict[int, str] = {}


def load_field(path: str) -> Field:
    """The field of a model file, kept while the file stays the same.

    Raises:
        ModelFileError: as `read_model`.
    """
    try:
        status = os.stat(path)
    except OSError as error:
        raise ModelFileError(f"{os.path.basename(path)} cannot be read: {error.strerror or error}.") from error
    return _load_field(path, status.st_mtime_ns, status.st_size)


@functools.lru_cache(maxsize=4)
def _load_field(path: str, _modified_ns: int, _size: int) -> Field:
    return prepare(read_model(path))


def field_of(obj: bpy.types.Object) -> Field:
    """The field that an imported object shows.

    Raises:
        ModelFileError: the file is unusable, or is no longer the one that the object was made from.
    """
    path = bpy.path.abspath(obj.aa4d.filepath, library=obj.library)
    field = load_field(os.path.normpath(path))
    if len(obj.data.vertices) and points.ids(obj.data).max() >= carriers.point_count(field, obj.aa4d.carrier):
        raise ModelFileError(f"{os.path.basename(path)} has fewer anchors than {obj.name} shows; import it again.")
    return field


def show(obj: bpy.types.Object, frame: float) -> None:
    """Set the object's attributes to their values at a (fractional) frame of the timeline; does nothing if they are.

    Raises:
        ModelFileError: as `field_of`.
    """
    field = field_of(obj)
    mesh = obj.data
    t = field.model.time_of_rank(frame - names.FIRST_FRAME)
    # The stamp lies on the mesh and not in this module, so that undo and reload take it back with the positions.
    if mesh.get(names.TIME_PROPERTY) == t:
        return
    start = time.perf_counter()
    rows = points.ids(mesh)
    for attribute, values in carriers.evaluate(field, obj.aa4d.carrier, t).items():
        points.write(mesh, attribute.name, attribute.type, values[rows])
    mesh[names.TIME_PROPERTY] = t
    mesh.update()
    milliseconds[obj.session_uid] = 1000 * (time.perf_counter() - start)


def is_live(obj: bpy.types.Object) -> bool:
    """Whether the handler evaluates this object; not in edit mode, where the mesh belongs to the person."""
    return obj.type == "MESH" and bool(obj.aa4d.filepath) and obj.aa4d.playback == "LIVE" and obj.mode != "EDIT"


@bpy.app.handlers.persistent
def on_frame_change(scene: bpy.types.Scene, _depsgraph: object = None) -> None:
    """Bring every live object of the scene to the current frame; called at sub-frames too, by motion blur."""
    for obj in scene.objects:
        if is_live(obj):
            try:
                show(obj, scene.frame_current_final)
                problems.pop(obj.session_uid, None)
            except ModelFileError as error:
                # A handler has no report line: say it once on the console, and in the panel while it lasts.
                if problems.get(obj.session_uid) != str(error):
                    print(f"AdaAnchor4D: {obj.name}: {error}")
                problems[obj.session_uid] = str(error)


def register() -> None:
    """Start listening."""
    bpy.app.handlers.frame_change_pre.append(on_frame_change)


def unregister() -> None:
    """Stop listening, and forget the models."""
    bpy.app.handlers.frame_change_pre.remove(on_frame_change)
    _load_field.cache_clear()
    milliseconds.clear()
    problems.clear()
