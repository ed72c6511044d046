"""Reading what was rendered, through the OpenImageIO that Blender bundles."""

import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from synth.errors import InputError

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
        for number, name in enumerate(spec.channelnames):
            # "ViewLayer.Depth.Z" or, in a part of its own, "Depth.Z"
            passes[".".join(name.split(".")[-2:])] = np.ascontiguousarray(pixels[..., number])
        part += 1
    source.close()
    return passes


def linear_rgb(passes: dict[str, NDArray[np.float32]]) -> NDArray[np.float32]:
    """The beauty pass [H, W, 3]."""
    return np.stack([passes[f"Combined.{channel}"] for channel in "RGB"], axis=-1)


def truth(passes: dict[str, NDArray[np.float32]]) -> dict[str, NDArray[Any]]:
    """Planar depth, +inf where nothing is hit, and instance ids: what truth/NNNNNN.npz holds."""
    depth = passes["Depth.Z"] if "Depth.Z" in passes else passes["Depth.V"]
    ids = next(value for name, value in passes.items() if name.split(".")[0] == "instance_id")
    return {
        "depth_z": np.where(depth < NO_HIT_M, depth, np.float32(np.inf)),
        "instance_id": np.round(ids).astype(np.uint32),
    }


def read_rgb(path: Path) -> NDArray[np.uint8]:
    """An 8-bit RGB image [H, W, 3]."""
    source = OIIO.ImageInput.open(str(path))
    if source is None:
        raise RuntimeError(f"{path}: the frame cannot be read back; delete it and run the same command again")
    pixels = source.read_image(0, 0, 0, 3, "uint8")
    source.close()
    return np.asarray(pixels)
