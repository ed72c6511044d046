"""points.ply: x y z (float), red green blue (uchar), binary little endian."""

import numpy as np

from synth.export.points import PointCloud


def ply(cloud: PointCloud) -> bytes:
    """The file's content."""
    rows = np.empty(len(cloud.positions), dtype=[("xyz", "<f4", 3), ("rgb", "u1", 3)])
    rows["xyz"], rows["rgb"] = cloud.positions, cloud.colours
    properties = [f"property float {name}" for name in "xyz"]
    properties += [f"property uchar {name}" for name in ("red", "green", "blue")]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}", *properties, "end_header", ""]
    return "\n".join(header).encode() + rows.tobytes()
