"""What a plan needs of this Blender: a build may lack optional parts, which is said before anything is written."""

from typing import Any

from synth.errors import InputError
from synth.plan import Plan

ELSEWHERE = "take the Blender of blender.org, which has it"


def refuse_what_is_missing(plan: Plan, bpy: Any) -> None:
    """Ask Blender for everything that the plan will set.

    Raises:
        InputError: this build lacks Cycles, OpenImageDenoise, FFmpeg, multilayer OpenEXR, or an importer.
    """
    scene = bpy.context.scene
    if not _takes(scene.render, "engine", "CYCLES"):
        raise InputError(f"This Blender was built without Cycles, which renders everything here; {ELSEWHERE}.")
    if plan.scene.render.denoise and not _takes(scene.cycles, "denoiser", "OPENIMAGEDENOISE"):
        raise InputError(
            "render.denoise: this Blender was built without OpenImageDenoise; set render.denoise = false and more "
            f"render.samples, or {ELSEWHERE}."
        )
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):  # since Blender 5.0
        settings.media_type = "MULTI_LAYER_IMAGE"
    if not _takes(settings, "file_format", "OPEN_EXR_MULTILAYER"):
        raise InputError(f"This Blender was built without OpenEXR, which carries the truth; {ELSEWHERE}.")
    for effect in plan.effects:
        if effect.stage == "encode" and not bpy.app.build_options.codec_ffmpeg:
            raise InputError(f"effects.{effect.name}: this Blender was built without FFmpeg; {ELSEWHERE}.")
    for model in plan.models:
        suffix = model.path.suffix.lower()
        group, name = IMPORTERS[suffix]
        if name not in dir(getattr(bpy.ops, group)):
            raise InputError(f"{model.path}: this Blender has no importer for {suffix} files; {ELSEWHERE}.")


IMPORTERS = {
    ".glb": ("import_scene", "gltf"),
    ".gltf": ("import_scene", "gltf"),
    ".obj": ("wm", "obj_import"),
    ".fbx": ("import_scene", "fbx"),
}


def _takes(settings: Any, name: str, value: str) -> bool:
    """Whether a setting has a value among its choices."""
    try:
        setattr(settings, name, value)
    except TypeError:
        return False
    return True
