"""What a person can do: import, bake, free, relink, inspect, export, composite. Each operator is thin over a plain
function."""

from pathlib import Path

import bpy
import numpy as np
from bpy.app.translations import pgettext_rpt as translated
from bpy_extras.io_utils import ExportHelper, ImportHelper

from . import (
    bake,
    compositing,
    exporter,
    importer,
    look_nodes,
    materials,
    modifiers,
    names,
    playback,
    points,
    properties,
    snapshot,
    warp_grid,
)
from .container import ModelFileError

LOOK_ITEMS = (
    ("AUTOMATIC", "Automatic", "Points for anchors, Gaussians for Gaussians"),
    *((look, look, description) for look, description in look_nodes.LOOKS.items()),
)
PRESETS = str(Path(__file__).parent)  # the folder that holds presets/operator/...
REGISTER_UNDO = {"REGISTER", "UNDO"}


class ImportModel(bpy.types.Operator, ImportHelper):
    """Import a trained scene as points that follow the timeline, with the drone's camera"""

    bl_idname = "aa4d.import_model"
    bl_label = "Import AdaAnchor4D"
    bl_options = {"REGISTER", "UNDO", "PRESET"}  # noqa: RUF012 - Blender's protocol

    filename_ext = ".safetensors"
    filter_glob: bpy.props.StringProperty(default="*.safetensors", options={"HIDDEN"})  # type: ignore[valid-type]
    carrier: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Carrier", description="What the points stand for", items=properties.CARRIER_ITEMS
    )
    look: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Look", description="How the points are drawn; the modifier changes it at any time", items=LOOK_ITEMS
    )
    view: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Seen From",
        description="The place that view-dependent colours are evaluated for",
        items=properties.VIEW_ITEMS,
    )
    import_camera: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Drone Camera", description="Import the capture's camera, animated, with its exact lens", default=True
    )
    background_frames: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Footage Behind",
        description="Show the capture's frames behind the drone camera, where they still lie beside the model",
        default=True,
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
    largest: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Most Points",
        description="Refuse more points than this: a million Gaussians take about a gigabyte",
        default=2_000_000,
        min=1,
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
        look = self.look
        if look == "AUTOMATIC":
            look = materials.POINTS if self.carrier == names.ANCHORS else materials.GAUSSIANS
        options = importer.ImportOptions(
            self.carrier,
            look,
            self.view,
            self.import_camera,
            self.background_frames,
            self.set_timeline,
            self.set_up_scene,
            self.largest,
        )
        try:
            imported = importer.import_model(self.filepath, context.scene, context.collection, options)
            if self.bake:
                _bake_now(context, imported.points, bake.BakeOptions())
        except ModelFileError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        for obj in context.selected_objects:
            obj.select_set(False)
        imported.points.select_set(True)
        context.view_layer.objects.active = imported.points
        message = translated("Imported {:,} points over {} frames; Material Preview shows their colours")
        self.report({"INFO"}, message.format(len(imported.points.data.vertices), imported.model.frame_count))
        return {"FINISHED"}


def is_imported(obj: bpy.types.Object | None) -> bool:
    """Whether the object was made by this add-on."""
    return obj is not None and obj.type == "MESH" and bool(obj.aa4d.filepath)


class OnImportedObject:
    """Shared poll of the operators on the active object."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """An imported object must be active, in object mode."""
        return is_imported(context.active_object) and context.active_object.mode == "OBJECT"


class Bake(OnImportedObject, bpy.types.Operator):
    """Store the clip in the object: plays back and renders without the model file and this add-on. Esc cancels"""

    bl_idname = "aa4d.bake"
    bl_label = "Bake"
    bl_options = {"REGISTER", "UNDO", "PRESET"}  # noqa: RUF012 - Blender's protocol

    use_range: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Range", description="Bake a part of the clip; its ends hold before and after it"
    )
    first: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="First", description="The clip's first frame to bake", default=1, min=1
    )
    last: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Last", description="The clip's last frame to bake", default=250, min=1
    )
    step: bpy.props.FloatProperty(  # type: ignore[valid-type]
        name="Step",
        description="Frames from key to key: more is smaller and less exact, a half is more exact for motion blur",
        default=1.0,
        min=0.1,
        max=100.0,
    )
    inspection: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Inspection", description="Bake displacement, speed and plane weights as well, to colour and filter by"
    )

    def bake_options(self) -> bake.BakeOptions:
        """What the properties say."""
        first, last = (self.first, self.last) if self.use_range else (1, None)
        return bake.BakeOptions(first, last, self.step, self.inspection)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Bake the active object, from a script."""
        if self.use_range and self.last < self.first:
            self.report({"ERROR"}, translated("The range to bake must not end before it begins"))
            return {"CANCELLED"}
        try:
            count = _bake_now(context, context.active_object, self.bake_options())
        except ModelFileError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, translated("Baked {} keys").format(count))
        return {"FINISHED"}

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """From a button: one frame after the other, with progress, until done or Esc."""
        self.work = bake.bake(context.active_object, context.scene, self.bake_options())
        self.timer = context.window_manager.event_timer_add(0.001, window=context.window)
        context.window_manager.progress_begin(0, 100)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """One key at each tick of the timer."""
        if event.type == "ESC":
            self.work.close()
            return self._end(context, {"WARNING"}, translated("Bake cancelled; nothing has changed"), {"CANCELLED"})
        if event.type != "TIMER":
            return {"RUNNING_MODAL"}
        try:
            done, count = next(self.work)
        except StopIteration:
            return self._end(context, {"INFO"}, translated("Baked"), {"FINISHED"})
        except (ModelFileError, MemoryError) as error:
            message = str(error) or translated("There is not enough memory for this bake")
            return self._end(context, {"ERROR"}, message, {"CANCELLED"})
        context.window_manager.progress_update(100 * done / count)
        context.workspace.status_text_set(translated("Baking {} of {}; Esc cancels").format(done, count))
        return {"RUNNING_MODAL"}

    def _end(self, context: bpy.types.Context, kind: set[str], message: str, result: set[str]) -> set[str]:
        context.window_manager.event_timer_remove(self.timer)
        context.window_manager.progress_end()
        context.workspace.status_text_set(None)
        self.report(kind, message)
        return result


class FreeBake(OnImportedObject, bpy.types.Operator):
    """Remove the baked keys and evaluate the model file again at every frame"""

    bl_idname = "aa4d.free_bake"
    bl_label = "Free Bake"
    bl_options = REGISTER_UNDO

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Free the active object."""
        obj = context.active_object
        bake.free(obj)
        try:
            playback.show(obj, context.scene)
        except ModelFileError as error:  # the keys are gone as asked; that nothing moves any more must be said
            self.report({"WARNING"}, str(error))
        return {"FINISHED"}


class Relink(OnImportedObject, bpy.types.Operator, ImportHelper):
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


class FreezeView(OnImportedObject, bpy.types.Operator):
    """Keep the view-dependent colours as the active camera sees them now"""

    bl_idname = "aa4d.freeze_view"
    bl_label = "Freeze View"
    bl_options = REGISTER_UNDO

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """There must be a camera."""
        return super().poll(context) and context.scene.camera is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Freeze the active object's view."""
        obj = context.active_object
        place = obj.matrix_world.inverted_safe() @ context.scene.camera.matrix_world.translation
        obj.aa4d.frozen_view, obj.aa4d.view = place, properties.FROZEN
        return {"FINISHED"}


class FitLegend(OnImportedObject, bpy.types.Operator):
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
        modifiers.put(look, look_nodes.LOW, float(low))
        modifiers.put(look, look_nodes.HIGH, float(max(high, low + 1e-6)))
        obj.update_tag()
        return {"FINISHED"}


def shown_scalar(obj: bpy.types.Object, look: bpy.types.Modifier) -> np.ndarray | None:
    """The quantity that the colours show, one value a point, or None where they show none."""
    shown = modifiers.get(look, look_nodes.COLOR_BY)

    def read(attribute: names.Attribute) -> np.ndarray:
        missing = attribute.name not in obj.data.attributes
        return np.zeros(len(obj.data.vertices)) if missing else points.read(obj.data, attribute.name)

    if shown == "Plane Weight":
        return read(names.WEIGHTS[names.PLANES.index(modifiers.get(look, look_nodes.PLANE))])
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
        lines = snapshot.statistics(obj.data, chosen)
        if mode == "EDIT":
            bpy.ops.object.mode_set(mode="EDIT")
        statistics[obj.session_uid] = lines
        self.report({"INFO"}, "; ".join(lines))
        return {"FINISHED"}


statistics: dict[int, list[str]] = {}  # for the panel, by the object's session id


class AddGrid(OnImportedObject, bpy.types.Operator):
    """Add the grid of the field's cells as DACW lays them into the world: fine where the model is fine"""

    bl_idname = "aa4d.add_grid"
    bl_label = "Add DACW Grid"
    bl_options = REGISTER_UNDO

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Add the active object's grid."""
        obj = context.active_object
        try:
            warp_grid.create_grid(playback.loaded_of(obj).field.model, obj)
        except ModelFileError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class LabelActivity(OnImportedObject, bpy.types.Operator):
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


class SetUpCompositing(OnImportedObject, bpy.types.Operator):
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

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Set up for the active object."""
        compositing.set_up(context, context.active_object, self.mode, sun=self.sun, passes=self.passes)
        return {"FINISHED"}


class _Export(OnImportedObject, ExportHelper):
    """What the two exports share."""

    bl_options = {"REGISTER", "PRESET"}  # noqa: RUF012 - Blender's protocol
    use_range: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Frame Range", description="Export every frame of the scene's range, not the current one alone"
    )

    def frames(self, scene: bpy.types.Scene) -> range:
        """Which frames to export."""
        if self.use_range:
            return range(scene.frame_start, scene.frame_end + 1)
        return range(scene.frame_current, scene.frame_current + 1)


class ExportPly(_Export, bpy.types.Operator):
    """Export what is shown as 3DGS splats, for viewers and editors of static splats"""

    bl_idname = "aa4d.export_ply"
    bl_label = "Export 3DGS PLY"
    filename_ext = ".ply"
    filter_glob: bpy.props.StringProperty(default="*.ply", options={"HIDDEN"})  # type: ignore[valid-type]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Export the active object."""
        try:
            written = exporter.export_ply(
                context.active_object, context, Path(bpy.path.abspath(self.filepath)), self.frames(context.scene)
            )
        except OSError as error:
            self.report({"ERROR"}, f"{error.filename or self.filepath}: {error.strerror or error}")
            return {"CANCELLED"}
        self.report({"INFO"}, translated("Wrote {} files").format(len(written)))
        return {"FINISHED"}


class ExportUsd(_Export, bpy.types.Operator):
    """Export the points as USD, animated over the frame range"""

    bl_idname = "aa4d.export_usd"
    bl_label = "Export USD Points"
    filename_ext = ".usdc"
    filter_glob: bpy.props.StringProperty(default="*.usd;*.usdc;*.usda", options={"HIDDEN"})  # type: ignore[valid-type]

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Export the active object."""
        obj = context.active_object
        selected = context.selected_objects
        try:
            exporter.export_usd(obj, context, Path(bpy.path.abspath(self.filepath)), self.frames(context.scene))
        except (OSError, RuntimeError) as error:
            self.report({"ERROR"}, str(error).strip().splitlines()[0])
            return {"CANCELLED"}
        finally:
            for other in selected:
                other.select_set(True)
            context.view_layer.objects.active = obj
        return {"FINISHED"}


def _bake_now(context: bpy.types.Context, obj: bpy.types.Object, options: bake.BakeOptions) -> int:
    """Bake to the end; the number of keys."""
    manager, count = context.window_manager, 0
    work = bake.bake(obj, context.scene, options)
    manager.progress_begin(0, 100)
    try:
        for done, count in work:
            manager.progress_update(100 * done / count)
    finally:
        manager.progress_end()
    return count


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


CLASSES = (
    ImportModel,
    Bake,
    FreeBake,
    Relink,
    FreezeView,
    FitLegend,
    MeasureSelection,
    AddGrid,
    LabelActivity,
    SetUpCompositing,
    ExportPly,
    ExportUsd,
    ModelFileHandler,
)


def _import_entry(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    self.layout.operator(ImportModel.bl_idname, text="AdaAnchor4D (.safetensors)")


def _export_entries(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    self.layout.operator(ExportPly.bl_idname, text="AdaAnchor4D Splats (.ply)")
    self.layout.operator(ExportUsd.bl_idname, text="AdaAnchor4D Points (.usdc)")


def register() -> None:
    """Register the operators, the drop handler, and the entries of File > Import and File > Export."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.utils.register_preset_path(PRESETS)
    bpy.types.TOPBAR_MT_file_import.append(_import_entry)
    bpy.types.TOPBAR_MT_file_export.append(_export_entries)


def unregister() -> None:
    """Take them out again."""
    bpy.types.TOPBAR_MT_file_export.remove(_export_entries)
    bpy.types.TOPBAR_MT_file_import.remove(_import_entry)
    bpy.utils.unregister_preset_path(PRESETS)
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
    statistics.clear()
