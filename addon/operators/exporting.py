"""Out again: splats, USD, and the flight of a camera."""

from pathlib import Path

import bpy
from bpy.app.translations import pgettext_rpt as translated
from bpy_extras.io_utils import ExportHelper

from .. import camera_path, exporter, parts
from ..container import ModelFileError
from .on_imported import OnImportedObject


class _Export(OnImportedObject, ExportHelper):
    """What the two exports share."""

    bl_options = {"REGISTER", "PRESET"}  # noqa: RUF012 - Blender's protocol
    use_range: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Frame Range", description="Export every frame of the scene's range, not the current one alone"
    )

    def target(self, suffixes: tuple[str, ...]) -> Path:
        """The file to write.

        Raises:
            OSError: that is no name for such a file.
        """
        path = Path(bpy.path.abspath(self.filepath))
        if not self.filepath or path.is_dir():
            raise OSError(translated("Choose a name for the file to write"))
        if path.suffix.lower() not in suffixes:
            raise OSError(translated("The name of the file must end in {}").format(", ".join(suffixes)))
        return path

    def failed(self, error: Exception) -> set[str]:
        """One line of what went wrong."""
        reason = getattr(error, "strerror", None) or str(error).strip().splitlines()[0].removeprefix("Error: ")
        self.report({"ERROR"}, f"{self.filepath}: {reason}" if isinstance(error, OSError) and self.filepath else reason)
        return {"CANCELLED"}

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
                context.active_object, context, self.target((self.filename_ext,)), self.frames(context.scene)
            )
        except OSError as error:
            return self.failed(error)
        self.report({"INFO"}, translated("Wrote {} files").format(len(written)))
        return {"FINISHED"}


class ExportUsd(_Export, bpy.types.Operator):
    """Export the points as USD, animated over the frame range"""

    bl_idname = "aa4d.export_usd"
    bl_label = "Export USD Points"
    filename_ext = ".usdc"
    filter_glob: bpy.props.StringProperty(default="*.usd;*.usdc;*.usda", options={"HIDDEN"})  # type: ignore[valid-type]

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Blender itself must know USD."""
        if exporter.has_usd():
            return super().poll(context)
        cls.poll_message_set("This Blender was built without USD")
        return False

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Export the active object."""
        obj = context.active_object
        selected = context.selected_objects
        try:
            exporter.export_usd(obj, context, self.target((".usdc", ".usda", ".usd")), self.frames(context.scene))
        except (OSError, RuntimeError) as error:
            return self.failed(error)
        finally:
            for other in selected:
                other.select_set(True)
            context.view_layer.objects.active = obj
        return {"FINISHED"}


class ExportCameraPath(_Export, bpy.types.Operator):
    """Export the flight of the scene's camera around the active import, for aa4d render --path"""

    bl_idname = "aa4d.export_camera_path"
    bl_label = "Export Camera Path"
    filename_ext = ".json"
    filter_glob: bpy.props.StringProperty(default="*.json", options={"HIDDEN"})  # type: ignore[valid-type]
    use_range: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Frame Range",
        description="Export a view for every frame of the scene's range, not for the current one alone",
        default=True,
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """There must be a camera."""
        if context.scene.camera is not None:
            return super().poll(context)
        cls.poll_message_set("The scene has no camera")
        return False

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Export the scene's camera."""
        try:
            frames = self.frames(context.scene)
            camera_path.write(self.target((self.filename_ext,)), parts.lead(context.active_object), context, frames)
        except (OSError, ModelFileError) as error:
            return self.failed(error)
        self.report({"INFO"}, translated("Wrote {} views").format(len(frames)))
        return {"FINISHED"}
