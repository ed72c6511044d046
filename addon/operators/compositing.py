"""Setting the scene up for CG objects."""

import bpy
from bpy.app.translations import pgettext_rpt as translated

from .. import compositing, parts
from ..scene import has_cycles
from .on_imported import OnOwnObject


class SetUpCompositing(OnOwnObject, bpy.types.Operator):
    """Set the scene up for CG objects among the reconstruction: shadows, hiding, depth and ids"""

    bl_idname = "aa4d.set_up_compositing"
    bl_label = "Set Up Compositing"
    bl_options = {"REGISTER", "UNDO", "PRESET"}  # noqa: RUF012 - Blender's protocol

    mode: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Mode", description="How the CG objects and the reconstruction come together", items=compositing.MODES
    )
    sun: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Sun", description="Add a sun where the scene has no light", default=True
    )
    passes: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Passes", description="Render depth, Cryptomatte, and the number of the anchor as passes", default=True
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Shadow catchers and holdouts are Cycles' own."""
        if has_cycles(context.scene):
            return super().poll(context)
        cls.poll_message_set("Cycles is switched off; switch it on in Preferences > Add-ons")
        return False

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Set up for the active object."""
        if not parts.lead(context.active_object).data.vertices:
            self.report({"ERROR"}, translated("The object has no points left"))
            return {"CANCELLED"}
        compositing.set_up(context, context.active_object, self.mode, sun=self.sun, passes=self.passes)
        return {"FINISHED"}
