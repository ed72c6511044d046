"""Places in the world of the surfaces that a frame shows, by its true depth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def surface_points(K: Array, viewmat: Array, depth: NDArray[np.float32]) -> Array:
    """World points [H, W, 3] of pixel centers at depths [H, W] along the camera's axis; NaN where the depth is not
    finite. K [3, 3], viewmat [4, 4] world to camera."""
    height, width = depth.shape
    v, u = np.mgrid[:height, :width] + 0.5
    rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones_like(u)], axis=-1)
    pose = np.linalg.inv(viewmat)
    along = np.where(np.isfinite(depth), depth, np.nan).astype(np.float64)
    return (rays * along[..., None]) @ pose[:3, :3].T + pose[:3, 3]
