"""What an import may change in the scene: the clip's timeline, and, only when asked, the look."""

import math

import bpy
import numpy as np

from . import names, parts
from .carriers import linear_rgba
from .clip import Clip

SAME_RATE = 1e-5  # Blender keeps a rate as a whole number and a float
TRANSPARENT_BOUNCES = 64  # Cycles' default of 8 turns overlapping Gaussians black


def is_timed(scene: bpy.types.Scene) -> bool:
    """Whether something plays in the scene that another frame rate would make faster or slower."""
    return any(
        parts.is_imported(obj) or (obj.animation_data is not None and obj.animation_data.action is not None)
        for obj in scene.objects
    )


def set_timeline(scene: bpy.types.Scene, clip: Clip) -> None:
    """Frame range, rate and picture size of the clip, so that the timeline and the drone camera match its frames."""
    scene.frame_start = names.FIRST_FRAME
    scene.frame_end = names.FIRST_FRAME + clip.frame_count - 1
    render, camera = scene.render, clip.camera
    render.fps = max(1, round(clip.fps))
    render.fps_base = render.fps / clip.fps
    render.resolution_x, render.resolution_y, render.resolution_percentage = camera.width, camera.height, 100
    aspect = camera.K[1, 1] / camera.K[0, 0]
    render.pixel_aspect_x, render.pixel_aspect_y = max(1.0, aspect), max(1.0, 1.0 / aspect)


def extend_timeline(scene: bpy.types.Scene, clip: Clip) -> None:
    """Let the frame range of a scene whose rate must stay hold the clip as well."""
    last = names.FIRST_FRAME + math.ceil((clip.frame_count - 1) * stretch(scene, clip) - SAME_RATE)
    scene.frame_start, scene.frame_end = min(scene.frame_start, names.FIRST_FRAME), max(scene.frame_end, last)


def stretch(scene: bpy.types.Scene, clip: Clip) -> float:
    """How many frames of the scene last as long as one of the clip."""
    ratio = scene.render.fps / scene.render.fps_base / clip.fps
    return 1.0 if abs(ratio - 1) < SAME_RATE else ratio


def has_cycles(scene: bpy.types.Scene) -> bool:
    """Whether Cycles is there: it is an add-on, which can be switched off or left out of a build."""
    return hasattr(scene, "cycles")


def use_cycles(scene: bpy.types.Scene) -> None:
    """Cycles, with bounces enough for Gaussians, none of which is left to chance: that would be noise."""
    scene.render.engine = "CYCLES"
    for bounces in ("transparent_max_bounces", "min_transparent_bounces"):
        setattr(scene.cycles, bounces, max(getattr(scene.cycles, bounces), TRANSPARENT_BOUNCES))


def set_up_scene(scene: bpy.types.Scene, camera: bpy.types.Object | None, clip: Clip) -> None:
    """The drone camera, colours as trained (Standard view transform), the model's background, Cycles where it is."""
    if camera is not None:
        scene.camera = camera
    if has_cycles(scene):
        use_cycles(scene)
    scene.view_settings.view_transform = "Standard"
    scene.view_settings.look = "None"
    world = bpy.data.worlds.new("AdaAnchor4D Background")
    if bpy.app.version < (5, 0):  # later ones always have nodes, and warn
        world.use_nodes = True
    background = next(node for node in world.node_tree.nodes if node.type == "BACKGROUND")
    color = linear_rgba(np.array([clip.background], np.float32))[0]
    background.inputs["Color"].default_value = color.tolist()
    world.color = color[:3].tolist()
    world[names.BACKGROUND_PROPERTY] = {"srgb": list(clip.background), "linear": color[:3].tolist()}
    scene.world = world
