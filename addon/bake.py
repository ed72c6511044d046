"""Baked playback: the clip as attribute keys on the mesh, read by Geometry Nodes without this add-on."""

import math
from collections.abc import Generator
from dataclasses import dataclass

import bpy
import numpy as np

from . import affine, names, parts, placement, playback, points, time_nodes
from . import modifiers as inputs
from .clip_time import ClipTime
from .container import ModelFileError
from .header import Doubles
from .properties import ACTIVE

WITH_KEYS = tuple(key.prefix for key in names.KEYS)


@dataclass(frozen=True)
class BakeOptions:
    """What to bake."""

    first: int = 1  # of the clip's frames, counted from 1
    last: int | None = None  # the clip's last frame where None
    step: float = 1  # frames from key to key, at most
    inspection: bool = False  # displacement, speed and plane weights as well


def bake(obj: bpy.types.Object, scene: bpy.types.Scene, options: BakeOptions) -> Generator[tuple[int, int], None, None]:
    """Write the keys of all objects of an import and switch to them; yields (keys written, keys in all) after each.

    The model is evaluated once a key, whatever number of objects shows it.

    What was baked before plays on until the end. An iterator that is closed early leaves everything as it was.

    Raises:
        ModelFileError: as `playback.loaded_of`, or the range is not of the clip; the object is left as it was.
    """
    loaded = playback.loaded_of(obj)
    objects = parts.parts(obj)
    for part in objects:
        playback.check_fits(part, loaded)
    carrier, source, clip = obj.aa4d.carrier, loaded.source, loaded.source.clip
    if options.first > clip.frame_count:
        raise ModelFileError(f"The clip has {clip.frame_count} frames; the range to bake begins after its end.")
    ranks = _ranks(options, clip.frame_count)
    always = {*names.APPEARANCE, *(names.INSPECTION if options.inspection else ())}
    parts.make_own(objects)
    work = []
    for mesh in dict.fromkeys(part.data for part in objects):
        users = [part for part in objects if part.data == mesh]
        rows = playback.rows_of(mesh)
        placement.follow_live(users[0], source, rows)
        attributes = always.union(*(playback.wanted_of(user) for user in users)).intersection(source.offers)
        work.append(_Work(mesh, rows, attributes, [time_modifier(user) for user in users], placement.map_of(mesh)))
    attributes = set().union(*(part.attributes for part in work))
    lead = objects[0]
    time, frame = playback.clip_time_of(lead, clip.frame_count), scene.frame_current_final
    try:
        for number, rank in enumerate(ranks):
            t = clip.time_of_rank(rank)
            if lead.aa4d.view == ACTIVE:  # the camera must be where it is then
                _go_to(scene, time, rank)
            center = playback.camera_center(lead, loaded, t, scene, None)
            values = source.evaluate(carrier, t, center, attributes)
            values[names.COLOR][:, 3] = values[names.OPACITY]
            for part in work:
                own = {attribute: values[attribute][part.rows] for attribute in part.attributes}
                if part.map is not None:
                    own = affine.moved(own, part.map)
                for key in names.keys_of(part.attributes):
                    name = names.UNFINISHED + names.key_name(key, number)
                    points.write(part.mesh, name, key.type, own[key.attribute])
            yield number + 1, len(ranks)
    except BaseException:
        for part in work:
            points.remove(part.mesh, (names.UNFINISHED,))
        raise
    finally:
        if lead.aa4d.view == ACTIVE:
            scene.frame_set(math.floor(frame), subframe=frame % 1)
    for part in work:
        points.remove(part.mesh, WITH_KEYS)
        for attribute in [a for a in part.mesh.attributes if a.name.startswith(names.UNFINISHED)]:
            attribute.name = attribute.name.removeprefix(names.UNFINISHED)
        for modifier in part.modifiers:
            modifier.node_group = time_nodes.baked_group(part.attributes)
            for name, value in (
                (time_nodes.CLIP_FRAMES, clip.frame_count),
                (time_nodes.KEY_FIRST, float(ranks[0])),
                (time_nodes.KEY_STEP, float(ranks[1] - ranks[0]) if len(ranks) > 1 else 1.0),
                (time_nodes.KEY_COUNT, len(ranks)),
            ):
                inputs.put(modifier, name, value)
        placement.show_first_key(part.mesh, clip.time_of_rank(ranks[0]))
    for part_object in objects:
        part_object.aa4d.playback = "BAKED"


@dataclass(frozen=True)
class _Work:
    """What one mesh of an import takes of a bake."""

    mesh: bpy.types.Mesh
    rows: slice | np.ndarray
    attributes: set[names.Attribute]
    modifiers: list[bpy.types.Modifier]  # of the objects that share the mesh
    map: Doubles | None  # from the model's metres to the mesh's


def largest_error_m(obj: bpy.types.Object, options: BakeOptions) -> float:
    """How far, at most, a vehicle's anchors leave their path between two keys, metres; 0 without vehicles.

    Raises:
        ModelFileError: as `playback.loaded_of`.
    """
    source = playback.loaded_of(obj).source
    clip = source.clip
    return source.chord_error_m([clip.time_of_rank(rank) for rank in _ranks(options, clip.frame_count)])


def color_errors(obj: bpy.types.Object, scene: bpy.types.Scene, options: BakeOptions) -> tuple[float, float] | None:
    """By how much colours are off at the middle key as the held-out cameras see them, with harmonics and without.

    None where nothing has harmonics, or no camera was held out.

    Raises:
        ModelFileError: as `playback.loaded_of`.
    """
    wanted = frozenset().union(*(playback.wanted_of(part) for part in parts.parts(obj)))
    if wanted.isdisjoint(names.HARMONICS):
        return None
    loaded, lead = playback.loaded_of(obj), parts.lead(obj)
    ranks = _ranks(options, loaded.source.clip.frame_count)
    t = loaded.source.clip.time_of_rank(ranks[len(ranks) // 2])
    center = playback.camera_center(lead, loaded, t, scene, None)
    values = loaded.source.evaluate(obj.aa4d.carrier, t, center, wanted)
    return loaded.source.color_errors(t, center, values)


def free(obj: bpy.types.Object) -> None:
    """Remove the keys of all objects of an import, if there are any, and switch them to live playback.

    Linked duplicates that do not belong to the import keep theirs.
    """
    parts.make_own(parts.parts(obj))
    for part in parts.parts(obj):
        points.remove(part.data, WITH_KEYS)
        time_modifier(part).node_group = time_nodes.live_group()
        part.aa4d.playback = "LIVE"
        part.data.pop(names.STAMP_PROPERTY, None)
        part.data.update()


def time_modifier(obj: bpy.types.Object) -> bpy.types.Modifier:
    """The object's time modifier, first in its stack; made again where a person has removed it."""
    modifier = obj.modifiers.get(names.TIME_MODIFIER)
    if modifier is None:
        modifier = obj.modifiers.new(names.TIME_MODIFIER, "NODES")
        obj.modifiers.move(len(obj.modifiers) - 1, 0)
        modifier.node_group = time_nodes.live_group()
    return modifier


def _go_to(scene: bpy.types.Scene, time: ClipTime, rank: float) -> None:
    """Go to the frame of the timeline at which a clip that is not reversed, held or looped shows this rank."""
    frame = time.start + rank / (time.speed or 1.0)
    scene.frame_set(math.floor(frame), subframe=frame % 1)


def _ranks(options: BakeOptions, frames: int) -> Doubles:
    """The ranks that get a key: evenly over the range, both ends among them, at most `step` frames apart."""
    last = frames if options.last is None else min(options.last, frames)
    first = min(max(options.first, 1), last)
    return np.linspace(first - 1, last - 1, math.ceil((last - first) / options.step) + 1)
