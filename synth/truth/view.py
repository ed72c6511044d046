"""One frame as the truth sees it: where the camera was and where every instance was, at one instant."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from synth.lens import Lens, pixel_rays

Array = NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """Arrays over instances follow `instance_id`, which is sorted."""

    lens: Lens
    size: tuple[int, int]  # width, height
    viewmat: Array  # [4, 4]
    instance_id: NDArray[np.uint32]  # [M]
    object_to_world: Array  # [M, 4, 4]
    present: NDArray[np.bool_]  # [M]

    def rays(self) -> Array:
        """Points at depth 1 in camera axes [H, W, 3] that the centres of the pixels see."""
        return pixel_rays(self.lens, self.size)

    def surface(self, depth_z: NDArray[np.float32]) -> Array:
        """World points [H, W, 3] of the pixels; NaN where nothing is hit."""
        depth = np.where(np.isfinite(depth_z), depth_z, np.nan).astype(np.float64)
        local = self.rays() * depth[..., None]
        return (local - self.viewmat[:3, 3]) @ self.viewmat[:3, :3]

    def index_of(self, ids: NDArray[np.uint32]) -> NDArray[np.int64]:
        """Row of each id in the arrays over instances; -1 for the background and for ids that do not exist."""
        if not len(self.instance_id):
            return np.full(ids.shape, -1)
        at = np.clip(np.searchsorted(self.instance_id, ids), 0, len(self.instance_id) - 1)
        return np.where(self.instance_id[at] == ids, at, -1)

    def project(self, points: Array) -> tuple[Array, Array]:
        """Pixel coordinates [..., 2] (NaN behind the camera) and planar depth [...] of world points [..., 3]."""
        local = self.local(points)
        return self.lens.project(local), local[..., 2]

    def local(self, points: Array) -> Array:
        """World points [..., 3] in camera axes."""
        return points @ self.viewmat[:3, :3].T + self.viewmat[:3, 3]
