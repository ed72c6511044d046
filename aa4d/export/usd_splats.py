"""OpenUSD's own Gaussian splats (ParticleField3DGaussianSplat, of 26.03 and later), moving.

All Gaussians that are drawn at any view are there at every one, with opacity 0 where they are not drawn: their number
does not change, so readers interpolate between the samples. Colors are spherical harmonics in sRGB, as in the PLY of
the original 3D Gaussian splatting; those of one Gaussian lie together.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from pxr import UsdVol, Vt

from aa4d.errors import InputError
from aa4d.export.clip import Clip
from aa4d.export.harmonics import SH_CONSTANT
from aa4d.export.keys import decoded, drawn_ids
from aa4d.export.usd_stage import stage_of

NAME = "splats.usdc"


def export(clip: Clip, out: Path, progress: Callable[[int, int], None]) -> None:
    """`out`/splats.usdc, a time sample at the second of each view; metres, z up.

    Raises:
        InputError: nothing would be drawn, or OpenUSD is too old to know splats.
    """
    path = out / NAME
    if path.exists():
        progress(2 * len(clip), 2 * len(clip))
        return
    if not hasattr(UsdVol, "ParticleField3DGaussianSplat"):
        raise InputError("--format usd: this OpenUSD knows no splats; pip install 'usd-core>=26.3', or take usd-points")
    ids = drawn_ids(clip, lambda done: progress(done, 2 * len(clip)))
    with stage_of(clip, path) as (stage, codes):
        splats = UsdVol.ParticleField3DGaussianSplat.Define(stage, "/AdaAnchor4D/splats")
        splats.CreateRadianceSphericalHarmonicsDegreeAttr(clip.degree)
        for index, values in enumerate(decoded(clip)):
            v, code = {name: value[ids] for name, value in values.items()}, codes[index]
            harmonics = v.get("harmonics", (v["color"] - 0.5) / np.float32(SH_CONSTANT)).reshape(-1, 3)
            corners = np.stack([v["position"].min(axis=0), v["position"].max(axis=0)])
            splats.CreatePositionsAttr().Set(Vt.Vec3fArray.FromNumpy(v["position"]), code)
            splats.CreateScalesAttr().Set(Vt.Vec3fArray.FromNumpy(np.exp(v["log_scale"])), code)
            xyzw = np.ascontiguousarray(v["rotation"][:, [1, 2, 3, 0]])  # as they lie in USD's memory
            splats.CreateOrientationsAttr().Set(Vt.QuatfArray.FromNumpy(xyzw), code)
            splats.CreateOpacitiesAttr().Set(Vt.FloatArray.FromNumpy(v["opacity"][:, 0].copy()), code)
            splats.CreateRadianceSphericalHarmonicsCoefficientsAttr().Set(Vt.Vec3fArray.FromNumpy(harmonics), code)
            splats.CreateExtentAttr().Set(Vt.Vec3fArray.FromNumpy(corners), code)
            progress(len(clip) + index + 1, 2 * len(clip))
        del splats, stage
