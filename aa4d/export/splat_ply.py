"""The PLY of the original 3D Gaussian splatting, which splat viewers open: one file a view.

Colours are the constant term of spherical harmonics, opacities are logits, scales logarithms, rotations w x y z.
SuperSplat plays such files as a sequence, by what their names share and the number after it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from plyfile import PlyData, PlyElement

from aa4d.export.clip import Clip, WorldGaussians
from aa4d.files import whole_file

SH_CONSTANT = 0.28209479177387814  # 1 / (2 sqrt(pi)): viewers show 0.5 + SH_CONSTANT * f_dc
OPAQUE = 1 - 1e-6  # a saturated tanh is exactly 1, whose logit is infinite
PREFIX = "clip_"  # of the files' names
DRAWN_AS = "SplatRenderMode: default"  # PlayCanvas's programs read there that the low-pass filter adds opacity
THINNEST_M = 1e-9  # a scale that underflowed is 0, whose logarithm is infinite

PROPERTIES = (
    *("x", "y", "z", "nx", "ny", "nz"),
    *("f_dc_0", "f_dc_1", "f_dc_2", "opacity"),
    *("scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"),
)


def export(clip: Clip, out: Path, progress: Callable[[int, int], None]) -> None:
    for index in range(len(clip)):
        path = out / f"{PREFIX}{clip.name(index)}.ply"
        if not path.exists():
            write_splat_ply(path, clip.gaussians(index), [DRAWN_AS, *clip.labels()])
        progress(index + 1, len(clip))


def write_splat_ply(path: Path, gaussians: WorldGaussians, comments: Sequence[str] = ()) -> None:
    g = gaussians
    opacity = np.minimum(g.opacities, OPAQUE)
    columns = np.concatenate(
        [
            g.means,
            np.zeros_like(g.means),  # normals: part of the layout, used by nobody
            (g.colors - 0.5) / SH_CONSTANT,
            np.log(opacity / (1 - opacity))[:, None],
            np.log(np.maximum(g.scales, THINNEST_M)),
            g.quaternions,
        ],
        axis=1,
    )
    vertex = np.empty(len(columns), dtype=[(name, "f4") for name in PROPERTIES])
    for name, column in zip(PROPERTIES, columns.T, strict=True):
        vertex[name] = column
    with whole_file(path) as temporary:
        PlyData([PlyElement.describe(vertex, "vertex")], byte_order="<", comments=comments).write(str(temporary))
