"""Splats through GaussForge (package gaussforge, Apache-2.0), which writes and reads SPZ and SOG."""

from __future__ import annotations

from typing import Any

import gaussforge
import numpy as np

from aa4d.errors import InputError
from aa4d.export.clip import WorldGaussians
from aa4d.export.splat_ply import THINNEST_M, logit


def written(gaussians: WorldGaussians, name: str) -> bytes:
    """The file's bytes in the format `name`, "spz" or "sog"; axes are kept as they are.

    Raises:
        InputError: the library refuses them.
    """
    g, coefficients = gaussians, gaussians.coefficients()
    columns = {
        "positions": g.means,
        "scales": np.log(np.maximum(g.scales, THINNEST_M)),
        "rotations": g.quaternions,
        "alphas": logit(g.opacities),
        "colors": coefficients[:, 0],
        "sh": coefficients[:, 1:],
    }
    scene: dict[str, Any] = {key: np.ascontiguousarray(value, "<f4").tobytes() for key, value in columns.items()}
    scene["numPoints"] = len(g.means)
    scene["meta"] = {"shDegree": round(np.sqrt(coefficients.shape[1])) - 1}
    found = gaussforge.GaussForge().write(scene, name)
    if "error" in found:
        raise InputError(f"--format {name}: GaussForge {gaussforge.__version__} says: {found['error']}")
    return bytes(found["data"])
