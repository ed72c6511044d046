"""What is seen after an import: the colours, the scene from the side of the drone, the clip in the timeline."""

from collections.abc import Sequence
from contextlib import suppress

import bpy
import numpy as np
from mathutils import Matrix

from . import camera, names, points
from .clip import Clip
from .container import Floats
from .header import Doubles

COLORLESS = ("WIREFRAME", "SOLID")  # kinds of shading in which points have no colour of their own
LEAST_OPACITY = 0.05
SHARE = 95  # percent of the points that are to lie within the view: single ones may be anywhere
MARGIN = 1.05
SENSOR_MM = 36.0  # of a 3D view: half its larger side at a distance of its lens


def show(context: bpy.types.Context, objects: Sequence[bpy.types.Object], clip: Clip) -> None:
    """Let all 3D views of the window show the colours, those that look through no camera the objects, and its timelines
    the whole clip."""
    places = _places(objects)
    for area in () if context.screen is None else context.screen.areas:
        window = next((region for region in area.regions if region.type == "WINDOW"), None)
        if area.type == "VIEW_3D" and window is not None:
            space = area.spaces.active
            if space.shading.type in COLORLESS:
                with suppress(TypeError):  # Workbench, where the scene renders with it, knows no materials
                    space.shading.type = "MATERIAL"
            if len(places) and space.region_3d.view_perspective != "CAMERA":
                _frame(space, places, _drone_axes(clip), (max(1, window.width), max(1, window.height)))
        elif area.type == "DOPESHEET_EDITOR" and window is not None and not bpy.app.background:
            with context.temp_override(area=area, region=window), suppress(RuntimeError):
                bpy.ops.action.view_all()


def _places(objects: Sequence[bpy.types.Object]) -> Floats:
    """Where the points of the objects are now, those that can be seen."""
    visible = [
        points.read(obj.data, names.POSITION.name)[points.read(obj.data, names.OPACITY.name) >= LEAST_OPACITY]
        for obj in objects
    ]
    return np.concatenate(visible)


def _drone_axes(clip: Clip) -> Doubles:
    """The axes of the capture's camera in the middle of the clip, [3, 3], in columns: right, up, back."""
    return clip.viewmats[len(clip.viewmats) // 2, :3, :3].T @ camera.OPENCV_TO_BLENDER


def _frame(space: bpy.types.SpaceView3D, places: Floats, axes: Doubles, size: tuple[int, int]) -> None:
    """Look at the places along these axes, from where most of them are within a view of this size."""
    seen = places.astype(np.float64) @ axes
    low, high = np.percentile(seen, [(100 - SHARE) / 2, (100 + SHARE) / 2], axis=0)
    middle = (low + high) / 2
    beside = seen - middle
    half = SENSOR_MM / space.lens * np.array(size) / max(size)
    needed = (np.abs(beside[:, :2]) / half).max(axis=1) + beside[:, 2]
    distance = MARGIN * max(float(np.percentile(needed, SHARE)), 1e-3)
    view = space.region_3d
    view.view_perspective = "PERSP"
    view.view_rotation = Matrix(axes.tolist()).to_quaternion()
    view.view_location = (axes @ middle).tolist()
    view.view_distance = distance
    space.clip_end = max(space.clip_end, 2 * (distance + float(np.ptp(beside[:, 2]))))
