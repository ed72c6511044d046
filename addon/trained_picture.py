"""A render that is the picture which `aa4d render` draws. Training blends sRGB values, Blender linear light: where
Gaussians are half transparent the two differ. So the colours are encoded once more, blended as they are, and shown
without a view transform; a pixel is what lies at its center, and nothing is smoothed."""

import bpy

from . import looks, materials, modifiers, names, parts, playback
from .looks import node_groups
from .scene import has_cycles

# What the scene needs, by where it stands; what was there before is kept under the last word.
SETTINGS = (
    ("view_settings.view_transform", "Raw"),
    ("view_settings.look", "None"),
    ("view_settings.exposure", 0.0),
    ("view_settings.gamma", 1.0),
    ("render.dither_intensity", 0.0),
    ("cycles.film_exposure", 1.0),
    ("cycles.pixel_filter_type", "GAUSSIAN"),  # of a box Cycles leaves the width at a pixel
    ("cycles.filter_width", 0.01),  # the narrowest: Gaussians bring the filter that they were trained with
    ("cycles.use_denoising", False),
    # The most, none left to chance: a ray through faint Gaussians meets more than a hundred.
    ("cycles.transparent_max_bounces", 1024),
    ("cycles.min_transparent_bounces", 1024),
)
SAME = 1e-6  # Blender keeps a number as a float of 32 bits


def is_on(scene: bpy.types.Scene) -> bool:
    """Whether the scene shows the trained picture."""
    return names.KEPT_PROPERTY in scene


def turn(scene: bpy.types.Scene, on: bool) -> bool:
    """Switch to the trained picture, or back to what was there before, for all imports of the scene: whether the world
    is one that `scene.set_up_scene` made, so that the background is right too."""
    if on and not is_on(scene):
        kept = {}
        for path, value in _settings(scene):
            owner, name = _place(scene, path)
            kept[name] = getattr(owner, name)
            setattr(owner, name, value)
        scene[names.KEPT_PROPERTY] = kept
    elif not on and is_on(scene):
        kept = scene[names.KEPT_PROPERTY].to_dict()
        for path, _ in _settings(scene):
            owner, name = _place(scene, path)
            if name in kept:  # an older version kept less
                setattr(owner, name, kept[name])
        del scene[names.KEPT_PROPERTY]
    for obj in scene.objects:
        if parts.is_imported(obj) and playback.is_ours(obj):
            follow(obj, scene)
    return _set_background(scene, on)


def _settings(scene: bpy.types.Scene) -> list[tuple[str, object]]:
    return [(path, value) for path, value in SETTINGS if has_cycles(scene) or not path.startswith("cycles.")]


def _place(scene: bpy.types.Scene, path: str) -> tuple[object, str]:
    """The owner of a setting and its name there."""
    owner, name = path.split(".")
    return getattr(scene, owner), name


def follow(obj: bpy.types.Object, scene: bpy.types.Scene) -> None:
    """Let an imported object draw the trained picture, glowing, where the scene shows it.

    A filter of opacity that nobody has changed gives way to the rasteriser's.
    """
    look = modifiers.of(obj, names.LOOK_MODIFIER)
    if look is None or not modifiers.has(look, looks.TRAINED_PICTURE):
        return
    if is_on(scene) and node_groups.is_older(look.node_group):  # before version 9 Gaussians stayed ellipsoids
        node_groups.renew(look)
    modifiers.put(look, looks.TRAINED_PICTURE, is_on(scene))
    usual = (looks.USUAL_OPACITY, materials.FAINTEST)
    before, after = usual if is_on(scene) else reversed(usual)
    if abs(modifiers.get(look, looks.MINIMUM_OPACITY) - before) < SAME:
        modifiers.put(look, looks.MINIMUM_OPACITY, after)
    if is_on(scene):
        modifiers.put(look, looks.LIT, False)
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
