"""Looking inside: the legend, numbers, the grid, labels."""

import bpy
import numpy as np
from bpy.app.translations import pgettext_rpt as translated

from .. import importer, looks, modifiers, names, playback, points, snapshot, warp_grid
from ..container import ModelFileError
from .on_imported import REGISTER_UNDO, OnImportedObject, OnOwnObject, is_imported

statistics: dict[int, list[str]] = {}  # for the panel, by the object's session id


class FitLegend(OnOwnObject, bpy.types.Operator):
    """Set the ends of the legend to the range of what is shown now, less the outermost percent"""

    bl_idname = "aa4d.fit_legend"
    bl_label = "Fit Legend"
    bl_options = REGISTER_UNDO

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Fit the active object's legend."""
        obj = context.active_object
        look = modifiers.of(obj, names.LOOK_MODIFIER)
        values = None if look is None else shown_scalar(obj, look)
        if values is None or not len(values):
            self.report({"WARNING"}, translated("The colours do not show a quantity"))
            return {"CANCELLED"}
        low, high = np.percentile(values, [1, 99])
        modifiers.put(look, looks.LOW, float(low))
        modifiers.put(look, looks.HIGH, float(max(high, low + 1e-6)))
        obj.update_tag()
        return {"FINISHED"}


def shown_scalar(obj: bpy.types.Object, look: bpy.types.Modifier) -> np.ndarray | None:
    """The quantity that the colours show, one value a point, or None where they show none."""
    shown = modifiers.get(look, looks.COLOR_BY)

    def read(attribute: names.Attribute) -> np.ndarray:
        missing = attribute.name not in obj.data.attributes
        return np.zeros(len(obj.data.vertices)) if missing else points.read(obj.data, attribute.name)

    if shown == "Plane Weight":
        return read(names.WEIGHTS[names.PLANES.index(modifiers.get(look, looks.PLANE))])
    if shown == "Motion Share":
        return sum((read(weight) for weight in names.WEIGHTS[3:]), np.zeros(len(obj.data.vertices)))
    sources = {
        "Displacement": names.DISPLACEMENT,
        "Speed": names.SPEED,
        "Opacity": names.OPACITY,
        "Reach": names.RADIUS,
    }
    return read(sources[shown]) if shown in sources else None


class MeasureSelection(bpy.types.Operator):
    """Say how many points are selected, where they are, and how they move"""

    bl_idname = "aa4d.measure_selection"
    bl_label = "Measure Selection"
    bl_options = {"REGISTER"}  # noqa: RUF012 - Blender's protocol

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """An imported object must be active, in any mode."""
        return is_imported(context.active_object)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Measure the active object's selected vertices."""
        obj = context.active_object
        mode = obj.mode
        if mode == "EDIT":  # attributes are out of reach there
            bpy.ops.object.mode_set(mode="OBJECT")
        chosen = np.zeros(len(obj.data.vertices), bool)
        obj.data.vertices.foreach_get("select", chosen)
        lines = snapshot.statistics(obj, chosen)
        if mode == "EDIT":
            bpy.ops.object.mode_set(mode="EDIT")
        statistics[obj.session_uid] = lines
        self.report({"INFO"}, "; ".join(lines))
        return {"FINISHED"}


class AddGrid(OnImportedObject, bpy.types.Operator):
    """Add the grid of the field's cells as DACW lays them into the world: fine where the model is fine"""

    bl_idname = "aa4d.add_grid"
    bl_label = "Add DACW Grid"
    bl_options = REGISTER_UNDO

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Add the active object's grid."""
        obj = context.active_object
        try:
            source = playback.loaded_of(obj).source
            if source.model is None:
                raise ModelFileError(f"{source.clip.path.name} is a track file, which has no field to draw.")
            warp_grid.create_grid(source.model, obj)
        except ModelFileError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class LabelActivity(OnOwnObject, bpy.types.Operator):
    """Give every point the activity that the capture's truth knows at its anchor, to colour by"""

    bl_idname = "aa4d.label_activity"
    bl_label = "Label Activity"
    bl_options = REGISTER_UNDO

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Label the active object's points."""
        obj = context.active_object
        try:
            counts = importer.label_activity(obj)
        except (ModelFileError, RuntimeError) as error:
            self.report({"ERROR"}, str(error).strip())
            return {"CANCELLED"}
        self.report({"INFO"}, ", ".join(f"{count:,} {label}" for label, count in counts.items()))
        return {"FINISHED"}
