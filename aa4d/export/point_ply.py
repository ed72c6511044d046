"""A point cloud for any program that reads PLY: the centres of the Gaussians with colours, one file a view."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from plyfile import PlyData, PlyElement

from aa4d.export.clip import Clip, WorldGaussians
from aa4d.files import whole_file


def export(clip: Clip, out: Path, progress: Callable[[int, int], None]) -> None:
    for index in range(len(clip)):
        path = out / f"{clip.name(index)}.ply"
        if not path.exists():
            write_point_ply(path, clip.gaussians(index), clip.labels())
        progress(index + 1, len(clip))


def write_point_ply(path: Path, gaussians: WorldGaussians, comments: Sequence[str] = ()) -> None:
    """Positions in metres, 8-bit sRGB colours, opacity in [0, 1] and the mean radius of one standard deviation.

    Of a model with rigid groups also the group of each point, -1 for the world's.
    """
    g = gaussians
    floats, bytes_ = ("x", "y", "z"), ("red", "green", "blue")
    layout = [(n, "f4") for n in floats] + [(n, "u1") for n in bytes_] + [("opacity", "f4"), ("radius", "f4")]
    if g.group is not None:
        layout.append(("group", "i4"))
    vertex = np.empty(len(g.means), dtype=layout)
    for name, column in zip(floats, g.means.T, strict=True):
        vertex[name] = column
    for name, column in zip(bytes_, (g.colors * 255).round().T, strict=True):
        vertex[name] = column
    vertex["opacity"], vertex["radius"] = g.opacities, g.scales.mean(axis=1)
    if g.group is not None:
        vertex["group"] = g.group
    with whole_file(path) as temporary:
        PlyData([PlyElement.describe(vertex, "vertex")], byte_order="<", comments=comments).write(str(temporary))
