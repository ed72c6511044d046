"""Import, from the menu, by drag and drop, or from a script."""

import os

import bpy
from bpy.app.translations import pgettext_rpt as translated
from bpy_extras.io_utils import ImportHelper

from .. import bake, first_sight, importer, looks, modifiers, names, parts, properties
from ..container import ModelFileError
from ..harmonics import HIGHEST
from ..looks import splats
from ..scene import has_cycles
from .baking import bake_now

AUTOMATIC = "AUTOMATIC"
LOOK_ITEMS = (
    (AUTOMATIC, "Automatic", "Points for anchors; for Gaussians splats of Blender's own where it has them"),
    *((look, look, description) for look, description in looks.LOOKS.items()),
)


class ImportModel(bpy.types.Operator, ImportHelper):
    """Import a trained scene as points that follow the timeline, with the drone's camera"""

    bl_idname = "aa4d.import_model"
    bl_label = "Import AdaAnchor4D"
    bl_options = {"REGISTER", "UNDO", "PRESET"}  # noqa: RUF012 - Blender's protocol

    filename_ext = ".safetensors"
    filter_glob: bpy.props.StringProperty(default="*.safetensors", options={"HIDDEN"})  # type: ignore[valid-type]
    carrier: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Carrier",
        description="What the points stand for; a track file has Gaussians alone",
        items=properties.CARRIER_ITEMS,
        default=names.GAUSSIANS if looks.SPLATS_KNOWN else names.ANCHORS,
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
        description="Set the scene's frame range, frame rate and resolution to the clip's. Where something is animated "
        "already the rate stays, and the clip plays by its seconds",
        default=True,
    )
    set_up_scene: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Set Up Scene",
        description="Also set what shows the trained colours: camera, Cycles, Standard view transform, background",
        default=False,
    )
    trained_picture: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Trained Picture",
        description="Render what aa4d render draws: sRGB values are blended, as in training. The panel switches it",
        default=False,
    )
    harmonics: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Harmonics",
        description="Degree of spherical harmonics by which colours of Native Splats follow every camera; 0: none",
        default=0,
        min=0,
        max=HIGHEST,
        options=set() if looks.SPLATS_KNOWN else {"HIDDEN"},
    )
    vehicles: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Vehicles as Objects",
        description="An object for each vehicle, to select, hide, delete and colour, where the model knows vehicles",
        default=True,
    )
    bake: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Bake", description="Bake the clip at once: plays back without the model file and this add-on"
    )
    show: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Show at Once",
        description="Let the 3D views show the colours, in Material Preview, without the outline of a selection, and "
        "look at the scene as the drone does",
        default=True,
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
        if not self.filepath:
            return ImportHelper.invoke(self, context, event)
        # Not ImportHelper's own popup: it is for operators that take several files.
        return context.window_manager.invoke_props_dialog(
            self, title=os.path.basename(self.filepath), confirm_text=self.bl_label
        )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Import, make what was made active, and say what it is."""
        options = importer.ImportOptions(
            self.carrier,
            None if self.look == AUTOMATIC else self.look,
            self.view,
            self.import_camera,
            self.background_frames,
            self.set_timeline,
            self.set_up_scene,
            self.trained_picture,
            self.harmonics,
            self.vehicles,
            self.largest,
        )
        try:
            imported = importer.import_model(self.filepath, context.scene, context.collection, options)
            if self.bake:
                bake_now(context, imported.points, bake.BakeOptions())
        except (ModelFileError, MemoryError) as error:
            self.report({"ERROR"}, str(error) or translated("There is not enough memory for this import"))
            return {"CANCELLED"}
        for obj in context.selected_objects:
            obj.select_set(False)
        imported.points.select_set(not self.show)  # the outline of thousands of points would hide their colours
        context.view_layer.objects.active = imported.points
        together = parts.parts(imported.points)
        if self.show:
            first_sight.show(context, together, imported.clip)
        message = translated("Imported {:,} points over {} frames; Material Preview shows their colours")
        count = sum(len(part.data.vertices) for part in together)
        text = message.format(count, len(imported.clip.images))
        if len(together) > 1:
            text += translated("; {} vehicles").format(len(together) - 1)
        if imported.stretch != 1:
            render = context.scene.render
            rate = render.fps / render.fps_base
            text += translated("; {:.4g} frames a second in a scene of {:.4g}").format(imported.clip.fps, rate)
        self.report({"INFO"}, text)
        if self.set_up_scene and not has_cycles(context.scene):
            self.report({"WARNING"}, translated("Cycles is switched off: the render engine stays as it was"))
        look = modifiers.of(imported.points, names.LOOK_MODIFIER)
        if self.harmonics and look is not None and not splats.has_harmonics(imported.points, look):
            text = "Harmonics are of Native Splats of a model, which this import does not show"
            self.report({"WARNING"}, translated(text))
        return {"FINISHED"}


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
