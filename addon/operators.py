"""What a person can do: import, bake, free. Each operator is thin over a plain function."""

import bpy
from bpy_extras.io_utils import ImportHelper

from . import bake, importer, playback
from .container import ModelFileError
from .properties import CARRIER_ITEMS


class ImportModel(bpy.types.Operator, ImportHelper):
    """Import a trained scene as points that follow the timeline, with the drone's camera"""

    bl_idname = "aa4d.import_model"
    bl_label = "Import AdaAnchor4D"
    bl_options = {"REGISTER", "UNDO", "PRESET"}  # noqa: RUF012 - Blender's protocol

    filename_ext = ".safetensors"
    filter_glob: bpy.props.StringProperty(default="*.safetensors", options={"HIDDEN"})  # type: ignore[valid-type]
    carrier: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Carrier", description="What the points stand for", items=CARRIER_ITEMS
    )
    import_camera: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Drone Camera", description="Import the capture's camera, animated, with its exact lens", default=True
    )
    set_timeline: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Set Timeline",
        description="Set the scene's frame range, frame rate and resolution to the clip's",
        default=True,
    )
    set_up_scene: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Set Up Scene",
        description="Also set what shows the trained colours: camera, Cycles, Standard view transform, background",
        default=False,
    )
    bake: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Bake", description="Bake the clip at once: plays back without the model file and this add-on"
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Objects are made and selected, which edit modes do not allow."""
        return context.mode == "OBJECT"

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """A dropped file asks for the options alone, the menu for the file too."""
        return self.invoke_popup(context) if self.filepath else ImportHelper.invoke(self, context, event)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Import, select what was made, and say what it is."""
        options = importer.ImportOptions(self.carrier, self.import_camera, self.set_timeline, self.set_up_scene)
        try:
            imported = importer.import_model(self.filepath, context.scene, context.collection, options)
            if self.bake:
                _bake(context, imported.points)
        except ModelFileError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        for obj in context.selected_objects:
            obj.select_set(False)
        imported.points.select_set(True)
        context.view_layer.objects.active = imported.points
        self.report(
            {"INFO"},
            f"Imported {len(imported.points.data.vertices):,} points over {imported.model.frame_count} frames; "
            "Material Preview shows their colours",
        )
        return {"FINISHED"}


class _OnImportedObject:
    """Shared poll of the operators on the active object."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """An imported object must be active, in object mode."""
        obj = context.active_object
        return obj is not None and obj.type == "MESH" and bool(obj.aa4d.filepath) and obj.mode == "OBJECT"


class Bake(_OnImportedObject, bpy.types.Operator):
    """Store every frame of the clip in the object: plays back and renders without the model file and this add-on"""

    bl_idname = "aa4d.bake"
    bl_label = "Bake"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender's protocol

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Bake the active object."""
        try:
            count = _bake(context, context.active_object)
        except ModelFileError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, f"Baked {count} frames")
        return {"FINISHED"}


class FreeBake(_OnImportedObject, bpy.types.Operator):
    """Remove the baked frames and evaluate the model file again at every frame"""

    bl_idname = "aa4d.free_bake"
    bl_label = "Free Bake"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender's protocol

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Free the active object."""
        obj = context.active_object
        bake.free(obj)
        try:
            playback.show(obj, context.scene.frame_current_final)
        except ModelFileError as error:  # the keys are gone as asked; that nothing moves any more must be said
            self.report({"WARNING"}, str(error))
        return {"FINISHED"}


def _bake(context: bpy.types.Context, obj: bpy.types.Object) -> int:
    manager = context.window_manager
    manager.progress_begin(0, playback.field_of(obj).model.frame_count)
    try:
        return bake.bake(obj, manager.progress_update)
    finally:
        manager.progress_end()


class ModelFileHandler(bpy.types.FileHandler):
    """Drag and drop of a model file onto the 3D view or the outliner."""

    bl_idname = "AA4D_FH_model"
    bl_label = "AdaAnchor4D"
    bl_import_operator = ImportModel.bl_idname
    bl_file_extensions = ".safetensors"

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        """Where objects are dropped."""
        return context.area is not None and context.area.type in {"VIEW_3D", "OUTLINER"}


CLASSES = (ImportModel, Bake, FreeBake, ModelFileHandler)


def _menu_entry(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    self.layout.operator(ImportModel.bl_idname, text="AdaAnchor4D (.safetensors)")


def register() -> None:
    """Register the operators, the drop handler and File > Import."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.TOPBAR_MT_file_import.append(_menu_entry)


def unregister() -> None:
    """Take them out again."""
    bpy.types.TOPBAR_MT_file_import.remove(_menu_entry)
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
