"""Bake and free."""

import bpy
from bpy.app.translations import pgettext_rpt as translated

from .. import bake, parts, playback
from ..container import ModelFileError
from .on_imported import REGISTER_UNDO, OnOwnObject


class Bake(OnOwnObject, bpy.types.Operator):
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
            count = bake_now(context, context.active_object, self.bake_options())
        except ModelFileError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, self.done(context, count))
        return {"FINISHED"}

    def done(self, context: bpy.types.Context, count: int) -> str:
        """What to say at the end: the keys, how far straight ways between them lead vehicles astray, and what harmonics
        leave of the colours' errors."""
        message = translated("Baked {} keys").format(count)
        try:
            error = bake.largest_error_m(context.active_object, self.bake_options())
            colors = bake.color_errors(context.active_object, context.scene, self.bake_options())
        except ModelFileError:  # the file has gone meanwhile: the bake is whole without it
            return message
        if error > 0:
            message += translated("; between them vehicles are at most {:.3f} m off their path").format(error)
        if colors is not None:
            message += translated("; colours are off by {:.4f} with harmonics, {:.4f} without").format(*colors)
        return message

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """From a button: one frame after the other, with progress, until done or Esc."""
        self.work = bake.bake(context.active_object, context.scene, self.bake_options())
        self.count = 0
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
            done, self.count = next(self.work)
        except StopIteration:
            return self._end(context, {"INFO"}, self.done(context, self.count), {"FINISHED"})
        except (ModelFileError, MemoryError) as error:
            message = str(error) or translated("There is not enough memory for this bake")
            return self._end(context, {"ERROR"}, message, {"CANCELLED"})
        context.window_manager.progress_update(100 * done / self.count)
        context.workspace.status_text_set(translated("Baking {} of {}; Esc cancels").format(done, self.count))
        return {"RUNNING_MODAL"}

    def _end(self, context: bpy.types.Context, kind: set[str], message: str, result: set[str]) -> set[str]:
        context.window_manager.event_timer_remove(self.timer)
        context.window_manager.progress_end()
        context.workspace.status_text_set(None)
        self.report(kind, message)
        return result


class FreeBake(OnOwnObject, bpy.types.Operator):
    """Remove the baked keys and evaluate the model file again at every frame"""

    bl_idname = "aa4d.free_bake"
    bl_label = "Free Bake"
    bl_options = REGISTER_UNDO

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Free the active object."""
        obj = context.active_object
        bake.free(obj)
        try:
            for part in parts.parts(obj):
                playback.show(part, context.scene)
        except ModelFileError as error:  # the keys are gone as asked; that nothing moves any more must be said
            self.report({"WARNING"}, str(error))
        return {"FINISHED"}


def bake_now(context: bpy.types.Context, obj: bpy.types.Object, options: bake.BakeOptions) -> int:
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
