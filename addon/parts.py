"""The objects that one import made: its lead, which shows the world, and its vehicles, the lead's children."""

from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np
from bpy.app.translations import pgettext_data as translated

from . import camera, clip_time, modifiers, names, time_nodes
from .field import Indices
from .model import Model
from .source import MODEL

DRIVEN = (
    time_nodes.START,
    time_nodes.SPEED,
    time_nodes.REVERSE,
    time_nodes.OUTSIDE,
    time_nodes.BY_HAND,
    time_nodes.TIME,
)
UNTOUCHED: dict[str, Any] = dict(zip(DRIVEN, (1.0, 1.0, False, clip_time.HOLD, False, 1.0), strict=True))
HANDLE_M = 1.0  # length of a handle's axes
LONGEST_NAME = 50  # characters; Blender cuts after 63 bytes, and adds a number where a name is taken


def is_imported(obj: bpy.types.Object | None) -> bool:
    """Whether the object was made by this add-on."""
    return obj is not None and obj.type == "MESH" and bool(obj.aa4d.filepath)


def lead(obj: bpy.types.Object) -> bpy.types.Object:
    """The object that an imported one belongs to: itself where it belongs to none, or to one that is gone."""
    parent = obj.parent
    return parent if is_imported(parent) and key_of(parent) == key_of(obj) else obj


def parts(obj: bpy.types.Object) -> list[bpy.types.Object]:
    """All objects of an import, the lead first."""
    first = lead(obj)
    return [first, *(child for child in first.children if is_imported(child) and lead(child) == first)]


def shown_with(obj: bpy.types.Object) -> list[bpy.types.Object]:
    """What a person sees of the object and, where it is a lead, of its vehicles."""
    return [part for part in (parts(obj) if lead(obj) == obj else [obj]) if part.visible_get()]


def shows_anchors_alone(obj: bpy.types.Object) -> bool:
    """Whether its motion is that of anchors which traffic passes along: those of a model that knows no vehicles."""
    return obj.aa4d.kind == MODEL and names.GROUP.name not in obj.data.attributes


def make_own(objects: Sequence[bpy.types.Object]) -> None:
    """Give objects that share their mesh with others a copy of it, before it is changed: the others keep theirs."""
    own = set(objects)
    copies: dict[bpy.types.Mesh, bpy.types.Mesh] = {}
    shared = {obj.data for obj in bpy.data.objects if obj not in own}
    for obj in objects:
        if obj.data in shared:
            copies[obj.data] = copies.get(obj.data) or obj.data.copy()
            obj.data = copies[obj.data]


def key_of(obj: bpy.types.Object) -> tuple[str, str]:
    """What tells apart the models and carriers that objects show."""
    return obj.aa4d.content, obj.aa4d.carrier


def rows_of_parts(model: Model) -> list[tuple[int, Indices]]:
    """The anchors of the world, as group -1, and of each group that has any."""
    assert model.groups is not None
    of_anchor = model.groups.of_anchor
    order = np.argsort(of_anchor, kind="stable")
    present, first = np.unique(of_anchor[order], return_index=True)
    rows = dict(zip(present.tolist(), np.split(order, first[1:]), strict=True))
    return [(-1, rows.pop(-1, np.empty(0, np.intp))), *rows.items()]


def vehicle_name(model: Model, group: int) -> str:
    """A group's name as Blender can show it."""
    assert model.groups is not None
    name = "".join(letter for letter in model.groups.names[group] if letter.isprintable()).strip()[:LONGEST_NAME]
    return name or translated("Vehicle {}").format(group + 1)


def follow(part: bpy.types.Object, first: bpy.types.Object) -> None:
    """Drive the part's time by the lead's, live and baked, in any Blender: no Python runs in these drivers."""
    for name in DRIVEN:
        driver = part.driver_add(modifiers.path_of(part.modifiers[names.TIME_MODIFIER], name)).driver
        driver.type = "SUM"
        source = driver.variables.new()
        source.targets[0].id = first
        source.targets[0].data_path = modifiers.path_of(first.modifiers[names.TIME_MODIFIER], name)


# The time inputs of each lead, by `key_of`: what its parts keep when it is deleted.
_times: dict[tuple[str, str], dict[str, Any]] = {}


def keep_time(obj: bpy.types.Object) -> bool:
    """Take drivers away whose lead is gone, and give the part the time that it had: Blender would set it to nought.

    To be called of objects without a parent; whether there was anything to do.
    """
    modifier = modifiers.of(obj, names.TIME_MODIFIER)
    if modifier is None:
        return False
    drivers = [] if obj.animation_data is None else list(obj.animation_data.drivers)
    paths = {modifiers.path_of(modifier, name): name for name in DRIVEN}
    lost = [curve for curve in drivers if curve.data_path in paths and _has_lost_its_lead(curve.driver)]
    if not lost:
        _times[key_of(obj)] = {name: modifiers.get(modifier, name) for name in DRIVEN}
        return False
    time = _times.get(key_of(obj), UNTOUCHED)
    for curve in lost:
        name = paths[curve.data_path]
        obj.driver_remove(curve.data_path)
        modifiers.put(modifier, name, time[name])
    obj.update_tag()
    return True


def _has_lost_its_lead(driver: bpy.types.Driver) -> bool:
    """Whether it is one of `follow`, and not a person's own, and leads nowhere."""
    variables = list(driver.variables)
    return (
        driver.type == "SUM"
        and len(variables) == 1
        and variables[0].type == "SINGLE_PROP"
        and variables[0].targets[0].id is None
    )


def forget_times() -> None:
    """Forget the times of all leads."""
    _times.clear()


def make_handle(model: Model, group: int, name: str, stretch: float) -> bpy.types.Object:
    """An empty that rides on a group's trajectory with a key a frame of the clip's clock, `stretch` frames of the
    timeline apart: to parent lamps and cameras to, to aim at."""
    assert model.groups is not None
    handle = bpy.data.objects.new(name, None)
    handle.empty_display_type, handle.empty_display_size = "ARROWS", HANDLE_M
    handle.rotation_mode = "QUATERNION"
    handle[names.GROUP.name] = group
    poses = [model.groups.at(model.time_of_rank(rank)) for rank in range(model.frame_count)]
    places = model.scale * np.array([pose.position[group] for pose in poses]) + model.translation
    turns = camera.in_one_hemisphere(np.array([pose.quaternions()[group] for pose in poses]))
    at = np.arange(model.frame_count) * stretch
    camera.animate(handle, "location", places, at)
    camera.animate(handle, "rotation_quaternion", turns, at)
    return handle
