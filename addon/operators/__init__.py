"""What a person can do, registered in one list. Each operator is thin over a plain function."""

from pathlib import Path

import bpy

from . import inspection
from .baking import Bake, FreeBake
from .compositing import SetUpCompositing
from .exporting import ExportCameraPath, ExportPly, ExportUsd
from .importing import ImportModel, ModelFileHandler
from .inspection import AddGrid, FitLegend, LabelActivity, MeasureSelection
from .linking import Relink
from .matching import MatchParts
from .picture import TrainedPicture
from .viewing import FreezeView

PRESETS = str(Path(__file__).parent.parent)  # the folder that holds presets/operator/...

CLASSES = (
    ImportModel,
    Bake,
    FreeBake,
    Relink,
    MatchParts,
    FreezeView,
    TrainedPicture,
    FitLegend,
    MeasureSelection,
    AddGrid,
    LabelActivity,
    SetUpCompositing,
    ExportPly,
    ExportUsd,
    ExportCameraPath,
    ModelFileHandler,
)


def _import_entry(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    self.layout.operator(ImportModel.bl_idname, text="AdaAnchor4D (.safetensors)")


def _export_entries(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    self.layout.operator(ExportPly.bl_idname, text="AdaAnchor4D Splats (.ply)")
    self.layout.operator(ExportUsd.bl_idname, text="AdaAnchor4D Points (.usdc)")
    self.layout.operator(ExportCameraPath.bl_idname, text="AdaAnchor4D Camera Path (.json)")


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
    inspection.statistics.clear()
