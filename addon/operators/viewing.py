"""What view-dependent colours are seen from."""

import bpy

from .. import parts, playback, properties
from .on_imported import REGISTER_UNDO, OnOwnObject


class FreezeView(OnOwnObject, bpy.types.Operator):
    """Keep the view-dependent colours as the active camera sees them now"""

    bl_idname = "aa4d.freeze_view"
    bl_label = "Freeze View"
    bl_options = REGISTER_UNDO

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """There must be a camera."""
        return super().poll(context) and context.scene.camera is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Freeze the view of the active object's import."""
        obj = parts.lead(context.active_object)
        obj.aa4d.frozen_view = playback.seen_from(obj, context.scene.camera)
        obj.aa4d.view = properties.FROZEN
        return {"FINISHED"}
