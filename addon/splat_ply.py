"""3DGS PLY: one splat a point, as the viewers and editors of static splats read it (docs/formats.md). No bpy here."""

import os
from pathlib import Path

import numpy as np

from .container import Floats

SH_0 = 0.28209479177387814  # the constant spherical harmonic, 1 / (2 sqrt(pi))
FAINTEST = 1 / 255  # opacity below which no rasteriser draws a splat: left out
OPAQUE = 1 - 1e-6  # the logit of 1 is infinite
THINNEST_M = 1e-9  # a scale that underflowed is 0, whose logarithm is infinite
PROPERTIES = (
    *("x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"),
    *("scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"),
)


def write_ply(path: Path, positions: Floats, srgb: Floats, opacity: Floats, scales: Floats, rotations: Floats) -> None:
    """Write splats: positions [n, 3] in metres, sRGB [n, 3] and opacity [n] in [0, 1], scales [n, 3] (standard
    deviations in metres), rotations [n, 4] w x y z, but for those too faint to draw. The file appears whole or not at
    all.

    Raises:
        OSError: it cannot be written.
    """
    drawn = opacity >= FAINTEST
    rows = np.zeros((int(drawn.sum()), len(PROPERTIES)), "<f4")
    rows[:, 0:3] = positions[drawn]
    rows[:, 6:9] = (srgb[drawn] - 0.5) / SH_0
    capped = np.minimum(opacity[drawn].astype(np.float64), OPAQUE)
    rows[:, 9] = np.log(capped / (1 - capped))
    rows[:, 10:13] = np.log(np.maximum(scales[drawn], THINNEST_M))
    rows[:, 13:17] = rotations[drawn]
    header = "\n".join(
        ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
        + [f"property float {name}" for name in PROPERTIES]
        + ["end_header\n"]
    )
    partial = path.with_name(f".{path.name}.part")  # what a killed process left is written over
    try:
        with partial.open("wb") as file:
            file.write(header.encode())
            file.write(rows.tobytes())
            file.flush()
            os.fsync(file.fileno())
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def srgb(linear: Floats) -> Floats:
    """Linear values as sRGB ones (IEC 61966-2-1)."""
    curved = 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, 12.92 * linear, curved).astype(np.float32)
