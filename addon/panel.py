"""The panels in the 3D view's sidebar."""

import textwrap

import bpy
from bpy.app.translations import pgettext_iface as translated

from . import looks, modifiers, names, operators, other_blenders, parts, playback, time_nodes, trained_picture
from .looks import colors, splats
from .operators.inspection import statistics
from .parts import is_imported
from .source import MODEL, TRACK

TIME_INPUTS = (
    time_nodes.START,
    time_nodes.SPEED,
    time_nodes.REVERSE,
    time_nodes.OUTSIDE,
    time_nodes.BY_HAND,
    time_nodes.TIME,
)
# Of the sidebar, in pixels at a resolution scale of 1: Blender's default width, what its tabs and edges take, and a
# letter in the mean.
DEFAULT_WIDTH, MARGINS, LETTER = 220, 46, 6.2

COLORS_STAY = "A track file: Gaussians in the colours of their export, the same from everywhere."
NO_PLANES = "A track file has no planes; their weights show as 0."
ANCHORS_ALONE = "This is how anchors move. The model knows no vehicles: traffic passes along its anchors and is faster."


class SidebarPanel:
    """Where all of these stand."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "AdaAnchor4D"


class ImportPanel(SidebarPanel, bpy.types.Panel):
    """Import, and what the active object is."""

    bl_idname = "AA4D_PT_import"
    bl_label = "Import AdaAnchor4D"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the panel."""
        layout = self.layout
        layout.operator(operators.ImportModel.bl_idname, text="Import Model", icon="IMPORT")
        obj = context.active_object
        if not is_imported(obj):
            return
        column = layout.column(align=True)
        kind = translated(obj.aa4d.bl_rna.properties["carrier"].enum_items[obj.aa4d.carrier].name)
        column.label(text=f"{len(obj.data.vertices):,} {kind}", icon="POINTCLOUD_DATA", translate=False)
        column.prop(obj.aa4d, "filepath", text="")
        if obj.aa4d.kind == TRACK:
            _draw_text(layout, context, translated(COLORS_STAY))
        vehicles = parts.parts(obj)[1:]
        if vehicles:
            text = translated("{} vehicles").format(len(vehicles))
            column.label(text=text, icon="AUTO", translate=False)
        problem = playback.problems.get(obj.session_uid)
        if obj.aa4d.playback == "BAKED":
            column.label(text="Baked", icon="CHECKMARK")
        elif problem is not None:
            column.label(text="Stands Still", icon="ERROR")
            _draw_text(layout, context, problem)
            layout.operator(operators.Relink.bl_idname, icon="LINKED")
        else:
            costs = [playback.milliseconds.get(part.session_uid) for part in parts.parts(obj)]
            cost = sum(ms for ms in costs if ms is not None) or None
            text = translated("Live") if cost is None else translated("Live: {:.1f} ms a frame").format(cost)
            column.label(text=text, icon="TIME", translate=False)
            error = playback.quick_errors_m.get(obj.session_uid)
            if error is not None:
                text = translated("Playing: {:.1f} mm off").format(1000 * error)
                column.label(text=text, icon="PLAY", translate=False)


class ObjectPanel(SidebarPanel):
    """A panel on the active imported object."""

    bl_parent_id = ImportPanel.bl_idname

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Shown for imported objects."""
        return is_imported(context.active_object)


class TimePanel(ObjectPanel, bpy.types.Panel):
    """When the clip plays, and where its points come from."""

    bl_idname = "AA4D_PT_time"
    bl_label = "Time"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the panel."""
        obj, layout = context.active_object, self.layout
        _draw_inputs(layout, modifiers.of(obj, names.TIME_MODIFIER), TIME_INPUTS)
        row = layout.row(align=True)
        row.operator(operators.Bake.bl_idname, text="Bake")
        row.operator(operators.Bake.bl_idname, text="Bake Range").use_range = True
        if obj.aa4d.playback == "BAKED":
            layout.operator(operators.FreeBake.bl_idname)


class LookPanel(ObjectPanel, bpy.types.Panel):
    """How the points are drawn."""

    bl_idname = "AA4D_PT_look"
    bl_label = "Look"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the panel."""
        obj, layout = context.active_object, self.layout
        inputs = (looks.LOOK, looks.SIZE, looks.LIT, looks.PAINT, looks.PAINT_SHARE)
        look = modifiers.of(obj, names.LOOK_MODIFIER)
        _draw_inputs(layout, look, inputs)
        if look is not None and other_blenders.is_replaced(look):
            _draw_text(layout, context, translated(other_blenders.DRAWN_AS_GAUSSIANS))
        on = trained_picture.is_on(context.scene)
        layout.operator(operators.TrainedPicture.bl_idname, icon="IMAGE_DATA", depress=on).use = not on
        if obj.aa4d.playback == "LIVE" and obj.aa4d.kind == MODEL:
            layout.label(text="Seen From")
            layout.prop(parts.lead(obj).aa4d, "view", text="")
            layout.operator(operators.FreezeView.bl_idname, icon="FREEZE")
        if look is not None and splats.has_harmonics(obj, look):
            _draw_inputs(layout, look, (looks.HARMONICS,))
            errors = playback.color_errors.get(obj.session_uid)
            if errors is not None and splats.harmonics_shown(obj, look) and obj.aa4d.playback == "LIVE":
                column = layout.column(align=True)
                for text, error in zip(("Colours off by {:.4f}", "Without: {:.4f}"), errors, strict=True):
                    column.label(text=translated(text).format(error), translate=False)


class VehiclesPanel(ObjectPanel, bpy.types.Panel):
    """The vehicles of the import, each to rename and to hide."""

    bl_idname = "AA4D_PT_vehicles"
    bl_label = "Vehicles"
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012 - Blender's protocol

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Shown where there are any."""
        return super().poll(context) and len(parts.parts(context.active_object)) > 1

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the panel."""
        layout = self.layout
        layout.operator(operators.MatchParts.bl_idname, icon="COPYDOWN")
        column = layout.column(align=True)
        for part in parts.parts(context.active_object)[1:]:
            row = column.row(align=True)
            row.prop(part, "name", text="")
            row.prop(part, "hide_viewport", text="")
            row.prop(part, "hide_render", text="")


class InspectionPanel(ObjectPanel, bpy.types.Panel):
    """What the colours show, what is hidden, ghosts, grid and numbers."""

    bl_idname = "AA4D_PT_inspection"
    bl_label = "Inspection"
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012 - Blender's protocol

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the panel."""
        obj, layout = context.active_object, self.layout
        look = modifiers.of(obj, names.LOOK_MODIFIER)
        if look is not None:
            shown = modifiers.get(look, looks.COLOR_BY)
            inputs = [looks.COLOR_BY]
            if shown == "Plane Weight":
                inputs.append(looks.PLANE)
            _draw_inputs(layout, look, inputs)
            if shown in colors.SCALARS:
                self.draw_legend(layout, look, colors.SCALARS[shown].unit)
            filters = (looks.MINIMUM_OPACITY, looks.NEAREST, looks.FARTHEST, looks.CROP)
            _draw_inputs(layout, look, filters)
            if modifiers.get(look, looks.CROP) != looks.NO_CROP:
                _draw_inputs(layout, look, (looks.CROP_OBJECT,))
        _draw_inputs(layout, modifiers.of(obj, names.TIME_MODIFIER), (time_nodes.TRAIL,))
        _draw_inputs(layout, look, (looks.TRAIL_DISTANCE,))
        if parts.shows_anchors_alone(obj) and _shows_motion(obj):
            _draw_text(layout, context, translated(ANCHORS_ALONE))
        if obj.aa4d.kind == TRACK and not playback.wanted_of(obj).isdisjoint(names.WEIGHTS):
            _draw_text(layout, context, translated(NO_PLANES))
        layout.operator(operators.LabelActivity.bl_idname, icon="AUTO")
        if obj.aa4d.kind == MODEL:
            layout.operator(operators.AddGrid.bl_idname, icon="MESH_GRID")
        layout.operator(operators.MeasureSelection.bl_idname, icon="INFO")
        for line in statistics.get(obj.session_uid, ()):
            _draw_text(layout, context, line)

    def draw_legend(self, layout: bpy.types.UILayout, look: bpy.types.Modifier, unit: str) -> None:
        """The colours, the values at their ends, and the unit."""
        ramp = colors.legend_group().nodes[colors.RAMP_NAME]
        box = layout.box()
        box.template_color_ramp(ramp, "color_ramp", expand=False)
        column = box.column(align=True)
        for name in (looks.LOW, looks.HIGH):
            text = f"{translated(name)} ({unit})" if unit else translated(name)
            column.prop(*modifiers.property_of(look, name), text=text, translate=False)
        box.operator(operators.FitLegend.bl_idname)


def _shows_motion(obj: bpy.types.Object) -> bool:
    """Whether colours, filters or ghosts depend on how anchors move."""
    shown = playback.wanted_of(obj)
    return playback.trail_length(obj) > 0 or names.DISPLACEMENT in shown or names.SPEED in shown


class OutputPanel(ObjectPanel, bpy.types.Panel):
    """Compositing and exports."""

    bl_idname = "AA4D_PT_output"
    bl_label = "Compositing and Export"
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012 - Blender's protocol

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the panel."""
        obj, layout = context.active_object, self.layout
        layout.operator_menu_enum(operators.SetUpCompositing.bl_idname, "mode")
        layout.prop(obj, "visible_shadow", text="Cast Shadows")
        layout.prop(obj, "is_holdout")
        layout.operator(operators.ExportPly.bl_idname, icon="EXPORT")
        layout.operator(operators.ExportUsd.bl_idname, icon="EXPORT")
        layout.operator(operators.ExportCameraPath.bl_idname, icon="CAMERA_DATA")
        layout.operator(operators.Relink.bl_idname, icon="LINKED")


def _draw_text(layout: bpy.types.UILayout, context: bpy.types.Context, text: str) -> None:
    """A text in as many lines as the panel's width asks for: Blender cuts what is longer."""
    region = context.region
    width = DEFAULT_WIDTH if region is None else region.width / (context.preferences.system.ui_scale or 1)
    column = layout.column(align=True)
    for line in textwrap.wrap(text, max(12, int((width - MARGINS) / LETTER))):
        column.label(text=line, translate=False)


def _draw_inputs(
    layout: bpy.types.UILayout, modifier: bpy.types.Modifier | None, inputs: tuple[str, ...] | list[str]
) -> None:
    """The inputs of a modifier, if it is still there.

    Names stand in the fields, those of menus above them: beside them, at the default width, they would be cut.
    """
    if modifier is None:
        return
    column = layout.column(align=True)
    for name in inputs:
        owner, path = modifiers.property_of(modifier, name)
        if modifiers.menu_items(modifier.node_group, name) or name == looks.CROP_OBJECT:
            column.label(text=name)
            text = ""
        else:
            text = name
        if name == looks.CROP_OBJECT and path != "value":  # a custom property offers no objects to choose from
            column.prop_search(owner, path, bpy.data, "objects", text=text)
        else:
            column.prop(owner, path, text=text)


CLASSES = (ImportPanel, TimePanel, LookPanel, VehiclesPanel, InspectionPanel, OutputPanel)


def register() -> None:
    """Register the panels."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    """Take them out again."""
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
