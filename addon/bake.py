"""Baked playback: the clip as attribute keys on the mesh, read by Geometry Nodes without this add-on."""

from collections.abc import Callable

import bpy
import numpy as np

from . import carriers, names, nodes, playback, points


def bake(obj: bpy.types.Object, on_frame: Callable[[int], None] = lambda _: None) -> int:
    """Write the keys of every frame and switch the object to them; returns the number of frames.

    Calls `on_frame` with the number of finished frames.

    Raises:
        ModelFileError: as `playback.field_of`; the object is left as it was.
    """
    field = playback.field_of(obj)
    free(obj)
    mesh, carrier, count = obj.data, obj.aa4d.carrier, field.model.frame_count
    rows = points.ids(mesh)
    for rank in range(count):
        values = carriers.evaluate(field, carrier, field.model.time_of_rank(rank))
        values[names.COLOR] = np.concatenate([values[names.COLOR][:, :3], values[names.OPACITY][:, None]], axis=1)
        for key in names.carrier_keys(carrier):
            points.write(mesh, names.key_name(key, rank), key.type, values[key.attribute][rows])
        on_frame(rank + 1)
    modifier = nodes.add_modifier(obj, names.KEYS_MODIFIER, nodes.keys_group(carrier))
    nodes.set_modifier_input(modifier, nodes.KEY_COUNT, count)
    obj.modifiers.move(len(obj.modifiers) - 1, 0)
    obj.aa4d.playback = "BAKED"
    mesh.update()
    return count


def free(obj: bpy.types.Object) -> None:
    """Remove the keys, if there are any, and switch the object to live playback."""
    mesh = obj.data
    prefixes = tuple(key.prefix for key in names.KEYS)
    for name in [attribute.name for attribute in mesh.attributes if attribute.name.startswith(prefixes)]:
        mesh.attributes.remove(mesh.attributes[name])
    modifier = obj.modifiers.get(names.KEYS_MODIFIER)
    if modifier is not None:
        obj.modifiers.remove(modifier)
    obj.aa4d.playback = "LIVE"
    mesh.update()
