"""The panel in the 3D view's sidebar."""

import bpy

from . import names, nodes, playback
from .operators import Bake, FreeBake, ImportModel


class ImportPanel(bpy.types.Panel):
    """Import, and what the active object shows."""

    bl_idname = "AA4D_PT_import"
    bl_label = "Import AdaAnchor4D"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "AdaAnchor4D"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the panel."""
        layout = self.layout
        layout.operator(ImportModel.bl_idname, text="Import Model", icon="IMPORT")
        obj = context.active_object
        if obj is None or obj.type != "MESH" or not obj.aa4d.filepath:
            return
        column = layout.column(align=True)
        column.label(text=f"{len(obj.data.vertices):,} {obj.aa4d.carrier.lower()}", icon="POINTCLOUD_DATA")
        column.prop(obj.aa4d, "filepath", text="")
        if obj.aa4d.playback == "BAKED":
            column.label(text="Baked", icon="CHECKMARK")
            column.operator(FreeBake.bl_idname)
        else:
            cost = playback.milliseconds.get(obj.session_uid)
            column.label(text="Live" if cost is None else f"Live: {cost:.1f} ms a frame", icon="TIME")
            column.operator(Bake.bl_idname)
        problem = playback.problems.get(obj.session_uid)
        if problem is not None:
            layout.label(text=problem, icon="ERROR")
        modifier = obj.modifiers.get(names.LOOK_MODIFIER)
        if modifier is not None and modifier.node_group is not None:
            for name in nodes.input_names(modifier.node_group):
                layout.prop(*nodes.modifier_input(modifier, name), text=name)


def register() -> None:
    """Register the panel."""
    bpy.utils.register_class(ImportPanel)


def unregister() -> None:
    """Take it out again."""
    bpy.utils.unregister_class(ImportPanel)
