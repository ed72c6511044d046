"""A render that is the picture which `aa4d render` draws. Training blends sRGB values, Blender linear light: where
Gaussians are half transparent the two differ. So the colours are encoded once more, blended as they are, and shown
without a view transform; and a pixel is what lies at its centre."""

import bpy

from . import look_nodes, modifiers, names, parts, playback
from .scene import has_cycles

VIEW, LOOK, FILTER, WIDTH = "view_transform", "look", "pixel_filter_type", "filter_width"
NARROWEST = 0.1  # of Cycles' filter, pixels: the Gaussians themselves bring the filter that they were trained with


def is_on(scene: bpy.types.Scene) -> bool:
    """Whether the scene shows the trained picture."""
    return names.KEPT_PROPERTY in scene


def turn(scene: bpy.types.Scene, on: bool) -> bool:
    """Switch to the trained picture, or back to what was there before, for all imports of the scene: whether the world
    is one that `scene.set_up_scene` made, so that the background is right too."""
    view = scene.view_settings
    if on and not is_on(scene):
        kept = {VIEW: view.view_transform, LOOK: view.look}
        if has_cycles(scene):
            kept |= {FILTER: scene.cycles.pixel_filter_type, WIDTH: scene.cycles.filter_width}
        scene[names.KEPT_PROPERTY] = kept
        view.view_transform, view.look = "Raw", "None"
        if has_cycles(scene):
            scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", NARROWEST
    elif not on and is_on(scene):
        kept = scene[names.KEPT_PROPERTY].to_dict()
        view.view_transform, view.look = kept[VIEW], kept[LOOK]
        if has_cycles(scene) and FILTER in kept:
            scene.cycles.pixel_filter_type, scene.cycles.filter_width = kept[FILTER], kept[WIDTH]
        del scene[names.KEPT_PROPERTY]
    for obj in scene.objects:
        if parts.is_imported(obj) and playback.is_ours(obj):
            follow(obj, scene)
    return _set_background(scene, on)


def follow(obj: bpy.types.Object, scene: bpy.types.Scene) -> None:
    """Let an imported object draw the trained picture, glowing, where the scene shows it."""
    look = modifiers.of(obj, names.LOOK_MODIFIER)
    if look is None or look_nodes.TRAINED_PICTURE not in [item.name for item in modifiers.inputs_of(look.node_group)]:
        return
    modifiers.put(look, look_nodes.TRAINED_PICTURE, is_on(scene))
    if is_on(scene):
        modifiers.put(look, look_nodes.LIT, False)
    obj.update_tag()


def _set_background(scene: bpy.types.Scene, on: bool) -> bool:
    world = scene.world
    if world is None or names.BACKGROUND_PROPERTY not in world or world.library is not None:
        return False
    srgb, linear = (list(world[names.BACKGROUND_PROPERTY][kind]) for kind in ("srgb", "linear"))
    for node in world.node_tree.nodes:
        if node.type == "BACKGROUND":
            node.inputs["Color"].default_value = [*(srgb if on else linear), 1.0]
    return True
