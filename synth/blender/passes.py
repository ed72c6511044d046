"""Reading what was rendered, through the OpenImageIO that Blender bundles."""

import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from synth.blender.materials import INSTANCE
from synth.errors import InputError
from synth.plan import Frame, Plan
from synth.truth.classes import CLASS_OF_SURFACE, class_id, class_number

CLASS = "class_id"  # the pass of the surfaces' classes
NO_HIT_M = 1e9  # Cycles writes 1e10 where a ray hits nothing


def _openimageio() -> Any:
    """The module. The PyPI wheel of bpy ships it in a folder that it does not put on the path."""
    try:
        import OpenImageIO
    except ImportError:
        version = f"python{sys.version_info.major}.{sys.version_info.minor}"
        bundled = Path(bpy.utils.resource_path("LOCAL")) / "python" / "lib" / version / "site-packages"
        sys.path.append(str(bundled))
        try:
            import OpenImageIO
        except ImportError:  # a Linux distribution may package it apart from Blender
            raise InputError(
                "This Blender has no OpenImageIO for Python: install it (Debian: `apt install python3-openimageio`), "
                "or take the Blender of blender.org, which bundles it."
            ) from None
    return OpenImageIO


OIIO = _openimageio()  # here, not at the first frame: a Blender without it is told so before a folder is made


def read_passes(path: Path) -> dict[str, NDArray[np.float32]]:
    """All channels [H, W] of a multilayer EXR by "pass.channel", single-part (Blender 4) or multi-part (Blender 5)."""
    source = OIIO.ImageInput.open(str(path))
    if source is None:
        raise RuntimeError(f"{path}: Blender's render cannot be read back")
    passes: dict[str, NDArray[np.float32]] = {}
    part = 0
    while source.seek_subimage(part, 0):
        spec = source.spec()
        pixels = source.read_image(part, 0, 0, spec.nchannels, "float")
        if pixels is None:
            raise RuntimeError(f"{path}: Blender's render is cut short")
        for number, name in enumerate(spec.channelnames):
            # "ViewLayer.Depth.Z" or, in a part of its own, "Depth.Z"
            passes[".".join(name.split(".")[-2:])] = np.ascontiguousarray(pixels[..., number])
        part += 1
    source.close()
    return passes


def linear_rgb(passes: dict[str, NDArray[np.float32]]) -> NDArray[np.float32]:
    """The beauty pass [H, W, 3]."""
    return np.stack([passes[f"Combined.{channel}"] for channel in "RGB"], axis=-1)


def needs_normals(plan: Plan) -> bool:
    """Asked for, or needed to carry depth through a lens."""
    return "normal" in plan.scene.truth.passes or any(plan.lens.margin_px)


def truth(passes: dict[str, NDArray[np.float32]], plan: Plan, frame: Frame) -> dict[str, NDArray[Any]]:
    """What truth/NNNNNN.npz holds: planar depth, +inf where nothing is hit, instance ids, and what is asked for."""
    asked = plan.scene.truth.passes
    depth = passes["Depth.Z"] if "Depth.Z" in passes else passes["Depth.V"]
    found: dict[str, NDArray[Any]] = {
        "depth_z": np.where(depth < NO_HIT_M, depth, np.float32(np.inf)),
        "instance_id": np.round(_value(passes, INSTANCE)).astype(np.uint32),
    }
    if needs_normals(plan):
        found["normal"] = np.stack([passes[f"Normal.{axis}"] for axis in "XYZ"], axis=-1)
    if "class_id" in asked:
        surface = np.round(_value(passes, CLASS)).astype(np.uint8)
        numbers = [class_number(member.class_name) for member in plan.cast.members()]
        found["class_id"] = class_id(surface, found["instance_id"], np.array([0, *numbers], dtype=np.uint8))
    if any(plan.lens.margin_px):
        from synth.effects.lens_distortion import truth as through_the_lens

        camera = plan.scene.camera
        size = (camera.width_px, camera.height_px)
        found = through_the_lens(plan.lens, found, size, frame.viewmat[:3, :3])
    if "normal" not in asked:
        found.pop("normal", None)
    return found


def _value(passes: dict[str, NDArray[np.float32]], name: str) -> NDArray[np.float32]:
    """A pass of single values, whatever this version of Blender calls its channel."""
    return next(value for channel, value in passes.items() if channel.split(".")[0] == name)


def add_class_pass(layer: Any) -> None:
    """A pass with the class of the surface: a constant in every material."""
    aov = layer.aovs.add()
    aov.name, aov.type = CLASS, "VALUE"
    for material in bpy.data.materials:
        tree = material.node_tree
        value, output = tree.nodes.new("ShaderNodeValue"), tree.nodes.new("ShaderNodeOutputAOV")
        value.outputs[0].default_value = float(class_number(CLASS_OF_SURFACE.get(material.name, "other")))
        output.aov_name = CLASS
        tree.links.new(value.outputs[0], output.inputs["Value"])


def read_rgb(path: Path) -> NDArray[np.uint8]:
    """An 8-bit RGB image [H, W, 3]."""
    source = OIIO.ImageInput.open(str(path))
    if source is None:
        raise RuntimeError(f"{path}: the frame cannot be read back; delete it and run the same command again")
    pixels = source.read_image(0, 0, 0, 3, "uint8")
    source.close()
    return np.asarray(pixels)
