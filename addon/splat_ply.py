"""3DGS PLY: one splat a point, as the viewers and editors of static splats read it. No bpy here."""

import os
from pathlib import Path

import numpy as np

from .container import Floats

SH_0 = 0.28209479177387814  # the constant spherical harmonic, 1 / (2 sqrt(pi))
FAINTEST, FULLEST = 1e-4, 1 - 1e-4  # opacities whose logits stay finite
PROPERTIES = (
    *("x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"),
    *("scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"),
)


def write_ply(path: Path, positions: Floats, srgb: Floats, opacity: Floats, scales: Floats, rotations: Floats) -> None:
    """Write splats: positions [n, 3] in metres, sRGB [n, 3] and opacity [n] in [0, 1], scales [n, 3] (standard
    deviations in metres), rotations [n, 4] w x y z. The file appears whole or not at all.

    Raises:
        OSError: it cannot be written.
    """
    rows = np.zeros((len(positions), len(PROPERTIES)), "<f4")
    rows[:, 0:3] = positions
    rows[:, 6:9] = (srgb - 0.5) / SH_0
    kept = np.clip(opacity.astype(np.float64), FAINTEST, FULLEST)
    rows[:, 9] = np.log(kept / (1 - kept))
    rows[:, 10:13] = np.log(np.maximum(scales, 1e-9))
    rows[:, 13:17] = rotations
    header = "\n".join(
        ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
        + [f"property float {name}" for name in PROPERTIES]
        + ["end_header\n"]
    )
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        with partial.open("wb") as file:
            file.write(header.encode())
            file.write(rows.tobytes())
            file.flush()
            os.fsync(file.fileno())
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)
