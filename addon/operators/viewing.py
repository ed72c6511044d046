"""What view-dependent colours are seen from."""

import bpy

from .. import parts, playback, properties, source
from .on_imported import REGISTER_UNDO, OnOwnObject


class FreezeView(OnOwnObject, bpy.types.Operator):
    """Keep the view-dependent colours as the active camera sees them now"""

    bl_idname = "aa4d.freeze_view"
    bl_label = "Freeze View"
    bl_options = REGISTER_UNDO

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """There must be a camera, and colours that depend on the view."""
        if not super().poll(context) or context.scene.camera is None:
            return False
        if context.active_object.aa4d.kind == source.MODEL:
            return True
        cls.poll_message_set("The colours of a track file are the same from everywhere")
        return False

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Freeze the view of the active object's import."""
        obj = parts.lead(context.active_object)
        obj.aa4d.frozen_view = playback.seen_from(obj, context.scene.camera)
        obj.aa4d.view = properties.FROZEN
        return {"FINISHED"}
