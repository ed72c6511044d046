"""The model's own frame: unit depth and centred, so that no learning rate or threshold depends on metres.

The unit is the median distance at which the cameras see the scene. A pixel then covers about 1 / focal length units
whatever the flying height, and a hovering drone (all cameras in one place) is as good as an arc: nothing divides by
the extent of the flight.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from aa4d.capture.reader import Capture
from aa4d.errors import InputError
from aa4d.raster.types import Camera

# Of a unit: what lies outside is no scene, and float32 cameras in such units overflow (docs/formats.md).
SMALLEST_UNIT_M, LARGEST_UNIT_M = 1e-6, 1e6


@dataclass(frozen=True)
class ModelFrame:
    """world = unit_m * model + origin_m."""

    unit_m: float
    origin_m: NDArray[np.float64]  # [3]

    def matrix(self) -> NDArray[np.float64]:
        """model_to_world, [4, 4]."""
        matrix = np.eye(4)
        matrix[:3, :3] *= self.unit_m
        matrix[:3, 3] = self.origin_m
        return matrix

    @staticmethod
    def from_matrix(matrix: NDArray[np.float64]) -> ModelFrame:
        return ModelFrame(float(matrix[0, 0]), np.array(matrix[:3, 3]))

    def to_model(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        return (points_m - self.origin_m) / self.unit_m

    def camera(
        self,
        viewmat: NDArray[np.float64],
        K: NDArray[np.float64],
        width: int,
        height: int,
        device: torch.device | None = None,
    ) -> Camera:
        """The camera that sees the model frame as `viewmat` sees the world; computed in float64, kept in float32."""
        matrix = np.array(viewmat)
        matrix[:3, 3] = (viewmat[:3, :3] @ self.origin_m + viewmat[:3, 3]) / self.unit_m
        return Camera(
            torch.tensor(matrix, dtype=torch.float32, device=device),
            torch.tensor(np.array(K), dtype=torch.float32, device=device),
            width,
            height,
            near=0.01,
        )


def frame_of(capture: Capture) -> ModelFrame:
    """Origin: the median point. Unit: the median depth of the points over the training cameras that see them.

    Raises:
        InputError: no training camera sees any point, or all points lie in its lens.
    """
    depths = []
    for i in capture.of_split("train"):
        viewmat = capture.frames[i].viewmat
        in_camera = capture.points @ viewmat[:3, :3].T + viewmat[:3, 3]
        z = in_camera[:, 2]
        in_front = z > 0
        pixels = in_camera[in_front] @ capture.camera.K.T / z[in_front, None]
        inside = (pixels >= 0).all(axis=1) & (pixels[:, 0] < capture.camera.width)
        depths.append(z[in_front][inside & (pixels[:, 1] < capture.camera.height)])
    seen = np.concatenate(depths)
    if not len(seen):
        raise InputError(
            f"{capture.folder}: no training camera sees any point of the initial point cloud; are the poses camera to "
            "world, or in OpenGL axes? docs/formats.md says what is expected"
        )
    unit = float(np.median(seen))
    if not SMALLEST_UNIT_M <= unit <= LARGEST_UNIT_M:
        raise InputError(
            f"{capture.folder}: its cameras see the points at {unit:.3g} m, expected {SMALLEST_UNIT_M:g} to "
            f"{LARGEST_UNIT_M:g} m; scale the scene"
        )
    return ModelFrame(unit, np.median(capture.points, axis=0))
