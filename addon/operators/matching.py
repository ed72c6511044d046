"""One look for all objects of an import."""

import bpy

from .. import modifiers, names, parts, time_nodes
from .on_imported import REGISTER_UNDO, OnOwnObject


class MatchParts(OnOwnObject, bpy.types.Operator):
    """Give the world and all vehicles of this import the look, the filters and the trail of the active object"""

    bl_idname = "aa4d.match_parts"
    bl_label = "Apply Look to All"
    bl_options = REGISTER_UNDO

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Copy the inputs from the active object to the others."""
        obj = context.active_object
        for part in parts.parts(obj):
            for name, only in ((names.LOOK_MODIFIER, None), (names.TIME_MODIFIER, (time_nodes.TRAIL,))):
                source, target = modifiers.of(obj, name), modifiers.of(part, name)
                if part != obj and source is not None and target is not None:
                    for key in only or [item.name for item in modifiers.inputs_of(source.node_group)]:
                        modifiers.put(target, key, modifiers.get(source, key))
            part.update_tag()
        return {"FINISHED"}
