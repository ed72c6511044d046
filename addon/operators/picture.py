"""Blending as in training."""

import bpy
from bpy.app.translations import pgettext_rpt as translated

from .. import trained_picture
from .on_imported import REGISTER_UNDO, OnOwnObject


class TrainedPicture(OnOwnObject, bpy.types.Operator):
    """Render what aa4d render draws: sRGB values are blended, as in training. Lights and CG objects look wrong in it"""

    bl_idname = "aa4d.trained_picture"
    bl_label = "Trained Picture"
    bl_options = REGISTER_UNDO

    use: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Use", description="On, or back to what the scene had before", default=True
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Switch all imports of the scene."""
        if not trained_picture.turn(context.scene, self.use) and self.use:
            self.report({"WARNING"}, translated("The world stays yours: only one of Set Up Scene is the background"))
        return {"FINISHED"}
