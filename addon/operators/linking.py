"""Which file an object shows."""

import bpy
from bpy_extras.io_utils import ImportHelper

from .. import importer
from ..container import ModelFileError
from .on_imported import REGISTER_UNDO, OnOwnObject


class Relink(OnOwnObject, bpy.types.Operator, ImportHelper):
    """Show another model file, or the same one where it lies now. Modifiers, animation and deleted points stay"""

    bl_idname = "aa4d.relink"
    bl_label = "Relink"
    bl_options = REGISTER_UNDO

    filename_ext = ".safetensors"
    filter_glob: bpy.props.StringProperty(default="*.safetensors", options={"HIDDEN"})  # type: ignore[valid-type]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Take the chosen file."""
        try:
            importer.relink(context.active_object, self.filepath, context.scene)
        except ModelFileError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}
