"""glTF with the extension KHR_gaussian_splatting, which viewers and game engines read: one binary file a view.

Every number is float32, y is up and a unit is a metre, as glTF has it. Colors are spherical harmonics in sRGB; a
program without the extension finds a cloud of colored points. `asset.extras` holds the export's identity, where on
Earth the world's origin is and the view's t.

No library on PyPI writes floats of these (fourdgs rounds harmonics to bytes), and the container is two chunks.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from aa4d import __version__
from aa4d.export.clip import Y_UP, Clip, WorldGaussians, turned
from aa4d.export.harmonics import degrees
from aa4d.export.usd_points import linear
from aa4d.files import whole_file

EXTENSION = "KHR_gaussian_splatting"
FLOAT32, POINTS, VERTICES = 5126, 0, 34962  # of glTF's enumerations
SHAPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}


def export(clip: Clip, out: Path, progress: Callable[[int, int], None]) -> None:
    """`out`/NAME.glb for each view."""
    for index in range(len(clip)):
        path = out / f"{clip.name(index)}.glb"
        if not path.exists():
            extras: dict[str, Any] = {"t": clip.path.views[index].t}
            if clip.origin is not None:
                extras["geographicOrigin"] = dict(clip.origin)
            if clip.identity is not None:
                extras["aa4d"] = clip.identity.as_json()
            with whole_file(path) as temporary:
                temporary.write_bytes(glb_of(turned(clip.some_gaussians(index), Y_UP), extras))
        progress(index + 1, len(clip))


def glb_of(gaussians: WorldGaussians, extras: dict[str, Any]) -> bytes:
    """The file's bytes; the Gaussians have y up."""
    columns = attributes_of(gaussians)
    payloads = {name: np.ascontiguousarray(column, "<f4") for name, column in columns.items()}
    accessors: list[dict[str, Any]] = []
    views: list[dict[str, int]] = []
    start = 0
    for name, payload in payloads.items():
        views.append({"buffer": 0, "byteOffset": start, "byteLength": payload.nbytes, "target": VERTICES})
        shape = SHAPES[payload.shape[1]]
        accessors.append({"bufferView": len(views) - 1, "componentType": FLOAT32, "count": len(payload), "type": shape})
        if name == "POSITION":
            accessors[-1] |= {"min": payload.min(axis=0).tolist(), "max": payload.max(axis=0).tolist()}
        start += payload.nbytes
    primitive = {
        "attributes": {name: index for index, name in enumerate(payloads)},
        "mode": POINTS,
        "extensions": {EXTENSION: {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}},
    }
    document = {
        "asset": {"version": "2.0", "generator": f"aa4d {__version__}", "extras": extras},
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "splats"}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": start}],
    }
    text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    binary = b"".join(payload.tobytes() for payload in payloads.values())
    chunks = [struct.pack("<I4s", len(part), name) + part for name, part in ((b"JSON", text), (b"BIN\0", binary))]
    return b"".join([struct.pack("<4sII", b"glTF", 2, 12 + sum(map(len, chunks))), *chunks])


def attributes_of(gaussians: WorldGaussians) -> dict[str, Any]:
    """Each attribute's name in glTF and its values [N, D]."""
    g, coefficients = gaussians, gaussians.coefficients()
    columns = {
        "POSITION": g.means,
        "COLOR_0": np.concatenate([linear(np.clip(g.colors, 0, 1)), g.opacities[:, None]], axis=1),
        f"{EXTENSION}:SCALE": g.scales,
        f"{EXTENSION}:ROTATION": g.quaternions[:, [1, 2, 3, 0]],
        f"{EXTENSION}:OPACITY": g.opacities[:, None],
    }
    bands = degrees(round(np.sqrt(coefficients.shape[1])) - 1)
    for index, band in enumerate(bands):
        columns[f"{EXTENSION}:SH_DEGREE_{band}_COEF_{index - band * band}"] = coefficients[:, index]
    return columns
