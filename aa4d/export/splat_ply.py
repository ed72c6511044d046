"""The PLY of the original 3D Gaussian splatting, which splat viewers open: one file a view.

Colours are spherical harmonics, the constant term alone unless more are asked for; opacities are logits, scales
logarithms, rotations w x y z. SuperSplat plays such files as a sequence, by what their names share and the number after
it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from plyfile import PlyData, PlyElement

from aa4d.export.clip import Array, Clip, WorldGaussians
from aa4d.files import whole_file

OPAQUE = 1 - 1e-6  # a saturated tanh is exactly 1, whose logit is infinite
PREFIX = "clip_"  # of the files' names
DRAWN_AS = "SplatRenderMode: default"  # PlayCanvas's programs read there that the low-pass filter adds opacity
THINNEST_M = 1e-9  # a scale that underflowed is 0, whose logarithm is infinite


def properties(rest: int) -> tuple[str, ...]:
    """The columns in their order, with `rest` harmonics from degree 1 on: those of red, then of green, then of blue."""
    return (
        *("x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"),
        *(f"f_rest_{index}" for index in range(3 * rest)),
        *("opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"),
    )


def export(clip: Clip, out: Path, progress: Callable[[int, int], None]) -> None:
    for index in range(len(clip)):
        path = out / f"{PREFIX}{clip.name(index)}.ply"
        if not path.exists():
            write_splat_ply(path, clip.gaussians(index), [DRAWN_AS, *clip.labels()])
        progress(index + 1, len(clip))


def write_splat_ply(path: Path, gaussians: WorldGaussians, comments: Sequence[str] = ()) -> None:
    g = gaussians
    coefficients = g.coefficients()
    columns = np.concatenate(
        [
            g.means,
            np.zeros_like(g.means),  # normals: part of the layout, used by nobody
            coefficients[:, 0],
            coefficients[:, 1:].swapaxes(1, 2).reshape(len(g.means), 3 * (coefficients.shape[1] - 1)),
            logit(g.opacities)[:, None],
            np.log(np.maximum(g.scales, THINNEST_M)),
            g.quaternions,
        ],
        axis=1,
    )
    names = properties(coefficients.shape[1] - 1)
    vertex = np.empty(len(columns), dtype=[(name, "f4") for name in names])
    for name, column in zip(names, columns.T, strict=True):
        vertex[name] = column
    with whole_file(path) as temporary:
        PlyData([PlyElement.describe(vertex, "vertex")], byte_order="<", comments=comments).write(str(temporary))


def logit(opacities: Array) -> Array:
    """log(o / (1 - o)), finite."""
    capped = np.minimum(opacities, OPAQUE)
    return np.log(capped / (1 - capped))
