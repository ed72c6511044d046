"""The flight of Blender's camera as a camera path, which `aa4d render --path` flies (docs/formats.md, version 1)."""

import json
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from . import placement, playback
from .camera import OPENCV_TO_BLENDER
from .clip import Clip
from .header import Doubles

FORMAT, VERSION = "aa4d-camera-path", 1
SAME = 1e-4  # how much axes may differ from those of a similarity, and a lens from the first one


def write(path: Path, obj: bpy.types.Object, context: bpy.types.Context, frames: Sequence[int]) -> None:
    """Write what the scene's camera sees of an imported object at these frames of the timeline: one view each.

    Raises:
        OSError: there is no such camera, its lens changes, the object is stretched, or the file cannot be written.
        ModelFileError: the model, which knows the times, is not found.
    """
    clip = playback.loaded_of(obj).source.clip
    scene, before = context.scene, context.scene.frame_current_final
    try:
        views, cameras = [], []
        for frame in frames:
            scene.frame_set(frame)
            depsgraph = context.evaluated_depsgraph_get()
            views.append(_view(obj.evaluated_get(depsgraph), clip, scene, depsgraph))
            cameras.append(_intrinsics(scene, depsgraph))
    finally:
        scene.frame_set(math.floor(before), subframe=before % 1)
    first = cameras[0]
    if any(not np.allclose(camera["K"], first["K"], rtol=SAME) for camera in cameras):
        raise OSError(f"the lens of {scene.camera.name} changes; a camera path has one lens for all views")
    fps = scene.render.fps / scene.render.fps_base
    document = {"format": FORMAT, "version": VERSION, "fps": fps, "camera": first, "views": views}
    partial = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        partial.write_text(json.dumps(document), encoding="utf-8")
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def _view(obj: bpy.types.Object, clip: Clip, scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> dict[str, Any]:
    """Pose and time at the current frame; `obj` is evaluated."""
    kept = placement.map_of(obj.original.data)
    place = np.array(obj.matrix_world, np.float64) @ (np.eye(4) if kept is None else kept)
    scale = float(np.cbrt(np.linalg.det(place[:3, :3])))
    turn = place[:3, :3] / (scale or 1.0)
    if scale <= 0 or np.abs(turn @ turn.T - np.eye(3)).max() > SAME:
        raise OSError(f"{obj.name} is stretched, flat or mirrored; scale it evenly, so that cameras stay cameras")
    matrix = np.array(scene.camera.evaluated_get(depsgraph).matrix_world, np.float64)
    axes = turn.T @ (matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=0)) @ OPENCV_TO_BLENDER
    viewmat = np.eye(4)
    viewmat[:3, :3] = axes.T
    viewmat[:3, 3] = -axes.T @ np.linalg.solve(place, matrix[:, 3])[:3]
    rank = playback.clip_time_of(obj, clip.frame_count).rank(scene.frame_current_final)
    return {"t": clip.time_of_rank(rank), "viewmat": viewmat.tolist()}


def _intrinsics(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> dict[str, Any]:
    """The scene's camera at the size of its pictures, as capture.json has it."""
    camera, render = scene.camera.evaluated_get(depsgraph), scene.render
    if camera.data.type != "PERSP":
        raise OSError(f"{camera.name} is no perspective camera")
    width, height = (
        max(1, side * render.resolution_percentage // 100) for side in (render.resolution_x, render.resolution_y)
    )
    seen: Doubles = np.array(
        camera.calc_matrix_camera(
            depsgraph, x=width, y=height, scale_x=render.pixel_aspect_x, scale_y=render.pixel_aspect_y
        ),
        np.float64,
    )
    # From -1 to 1 and y up, along -z, to pixels and y down, along z.
    K = [
        [seen[0, 0] * width / 2, 0.0, (1 - seen[0, 2]) * width / 2],
        [0.0, seen[1, 1] * height / 2, (1 + seen[1, 2]) * height / 2],
        [0.0, 0.0, 1.0],
    ]
    return {"model": "PINHOLE", "width": width, "height": height, "K": [[float(x) for x in row] for row in K]}
