"""OpenUSD: one file with animated points, which Blender, Houdini, Maya and usdview read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from pxr import Sdf, UsdGeom, Vt

from aa4d.export.clip import Array, Clip
from aa4d.export.usd_stage import stage_of

NAME = "points.usdc"


def export(clip: Clip, out: Path, progress: Callable[[int, int], None]) -> None:
    """`out`/points.usdc: the centres of the Gaussians as UsdGeomPoints, a time sample at the second of each view.

    World is z up and in metres; a width is twice the mean standard deviation; colours are linear, as USD wants them.
    Velocities are in metres a second, by which a reader moves the points between samples: their number changes.
    Of a model with rigid groups `primvars:group` is the group of each point, -1 for the world's, and
    `primvars:groupNames` the names of the groups.
    """
    path = out / NAME
    if path.exists():
        progress(len(clip), len(clip))
        return
    with stage_of(clip, path) as (stage, codes):
        points = UsdGeom.Points.Define(stage, "/AdaAnchor4D/points")
        primvars = UsdGeom.PrimvarsAPI(points)
        color = primvars.CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.vertex)
        opacity = primvars.CreatePrimvar("displayOpacity", Sdf.ValueTypeNames.FloatArray, UsdGeom.Tokens.vertex)
        group = None
        if clip.group_names():
            group = primvars.CreatePrimvar("group", Sdf.ValueTypeNames.IntArray, UsdGeom.Tokens.vertex)
            names = primvars.CreatePrimvar("groupNames", Sdf.ValueTypeNames.StringArray, UsdGeom.Tokens.constant)
            names.Set(Vt.StringArray(clip.group_names()))
            del names
        for index in range(len(clip)):
            g, code = clip.gaussians(index), codes[index]
            centers = g.means.astype(np.float32)
            widths = (2 * g.scales.mean(axis=1)).astype(np.float32)
            points.CreatePointsAttr().Set(Vt.Vec3fArray.FromNumpy(centers), code)
            points.CreateWidthsAttr().Set(Vt.FloatArray.FromNumpy(widths), code)
            velocities = clip.velocities(index, g.ids).astype(np.float32)
            points.CreateVelocitiesAttr().Set(Vt.Vec3fArray.FromNumpy(velocities), code)
            points.CreateIdsAttr().Set(Vt.Int64Array.FromNumpy(g.ids), code)
            if len(centers):
                box = Vt.Vec3fArray.FromNumpy(np.stack([centers.min(0), centers.max(0)]))
                points.CreateExtentAttr().Set(box, code)
            color.Set(Vt.Vec3fArray.FromNumpy(linear(g.colors).astype(np.float32)), code)
            opacity.Set(Vt.FloatArray.FromNumpy(g.opacities.astype(np.float32)), code)
            if group is not None and g.group is not None:
                group.Set(Vt.IntArray.FromNumpy(g.group), code)
            progress(index + 1, len(clip))
        del points, primvars, color, opacity, group, stage


def linear(srgb: Array) -> Array:
    """sRGB in [0, 1] to linear light."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((np.maximum(srgb, 0.04045) + 0.055) / 1.055) ** 2.4)
