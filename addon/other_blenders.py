"""Files that another Blender has saved: one that knows splats of its own, or one that does not."""

import bpy

from . import looks, materials, modifiers, names
from .looks import node_groups

DRAWN_AS_GAUSSIANS = "Native Splats need Blender 5.3; here they are drawn as Gaussians, slower and without harmonics."
CAN_BE_SPLATS = "saved by a Blender without splats of its own; this one has them: Look > Native Splats."


@bpy.app.handlers.persistent
def welcome(*_: object) -> None:
    """After a file is opened or something appended: offer every look of this Blender, and say once what is different.

    What plays and how it looks does not change.
    """
    older, splats = [], []
    for obj in bpy.data.objects:
        look = modifiers.of(obj, names.LOOK_MODIFIER)
        if look is None or obj.library is not None or obj.override_library is not None:
            continue
        if node_groups.lacks_splats(look.node_group):
            node_groups.renew(look)
            older.append(obj.name)
        elif is_replaced(look):
            splats.append(obj.name)
    for found, message in ((older, CAN_BE_SPLATS), (splats, DRAWN_AS_GAUSSIANS)):
        if found:
            others = f" and {len(found) - 1} others" if len(found) > 1 else ""
            print(f"AdaAnchor4D: {found[0]}{others}: {message}")


def is_replaced(look: bpy.types.Modifier) -> bool:
    """Whether a look modifier asks for splats that this Blender does not have."""
    return not looks.SPLATS_KNOWN and modifiers.get(look, looks.LOOK) == materials.SPLATS


LISTENERS = (bpy.app.handlers.load_post, bpy.app.handlers.blend_import_post)


def register() -> None:
    """Start listening."""
    for handlers in LISTENERS:
        handlers.append(welcome)


def unregister() -> None:
    """Stop listening."""
    for handlers in LISTENERS:
        handlers.remove(welcome)
