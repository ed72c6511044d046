"""A browser's camera (viser's position, orientation w x y z and vertical field of view) as the rasteriser takes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from aa4d.capture.schema import Frame, PinholeCamera

SAME_WAY = 5e-3  # radians
STEEP = 2e-3  # radians from straight down

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Eye:
    """From where and how wide a browser looks. Its axes are OpenCV's, as ours are. Equal to none but itself."""

    viewmat: Array  # [4, 4] world (metres) to camera
    fov: float  # vertical, radians

    def center(self) -> Array:
        """[3] metres."""
        return -self.viewmat[:3, :3].T @ self.viewmat[:3, 3]

    def ahead(self) -> Array:
        """[3] unit, the direction in which it looks."""
        return self.viewmat[2, :3]

    def is_seen_from(self, other: Eye, tolerance_m: float) -> bool:
        """Whether both stand at one place and look the same way. A browser's camera keeps no roll, so that is free."""
        near = np.linalg.norm(self.center() - other.center()) < tolerance_m
        return bool(near and self.ahead() @ other.ahead() > np.cos(SAME_WAY))


def to_orbit(eye: Eye, point_m: Array) -> Array:
    """[3] metres: the point ahead for a browser's camera to look at, whose up is the world's.

    Straight down has no such up: there the point is moved a little towards the picture's upper edge, which stays up.
    """
    distance = float(np.linalg.norm(point_m - eye.center()))
    up = -eye.viewmat[1, :3]
    is_steep = abs(eye.ahead()[2]) > np.cos(STEEP)
    return point_m + is_steep * STEEP * distance * np.array([up[0], up[1], 0.0])


def viewmat_of(wxyz: Array, position_m: Array) -> Array:
    """[4, 4] world to camera; `wxyz` [4] turns the camera's axes into the world's, `position_m` [3] is its centre."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(np.roll(wxyz, -1)).as_matrix().T
    matrix[:3, 3] = -matrix[:3, :3] @ position_m
    return matrix


def wxyz_of(viewmat: Array) -> Array:
    """[4], the inverse of `viewmat_of`."""
    return np.roll(Rotation.from_matrix(viewmat[:3, :3].T).as_quat(), 1)


def pinhole(fov: float, width: int, height: int) -> PinholeCamera:
    """Centred, with square pixels, that sees `fov` radians from top to bottom."""
    return _centred(height / 2 / np.tan(fov / 2), width, height)


def inside(fov: float, aspect: float, width: int, height: int) -> PinholeCamera:
    """A camera of another shape that sees all that one of `fov` and `aspect` (width over height) sees, no larger."""
    return _centred(min(height, width / aspect) / 2 / np.tan(fov / 2), width, height)


def _centred(focal: float, width: int, height: int) -> PinholeCamera:
    return PinholeCamera(width, height, np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]]))


def fov_that_shows(camera: PinholeCamera, aspect: float) -> float:
    """The vertical field of view, radians, in which a window of `aspect` shows the whole picture of a camera."""
    (fx, _, cx), (_, fy, cy) = camera.K[:2]
    across, along = max(cx, camera.width - cx) / fx, max(cy, camera.height - cy) / fy
    return 2 * float(np.arctan(max(along, across / aspect)))


def pose_at(frames: tuple[Frame, ...], t: float) -> Array:
    """[4, 4] world to camera, between the poses of the frames around t in [0, 1]."""
    after = int(np.clip(np.searchsorted([f.t for f in frames], t), 1, max(len(frames) - 1, 1)))
    if after >= len(frames):
        return frames[0].viewmat
    one, other = frames[after - 1], frames[after]
    share = float(np.clip((t - one.t) / (other.t - one.t), 0, 1))
    turns = Rotation.from_matrix(np.stack([one.viewmat[:3, :3].T, other.viewmat[:3, :3].T]))
    centers = [-f.viewmat[:3, :3].T @ f.viewmat[:3, 3] for f in (one, other)]
    matrix = np.eye(4)
    matrix[:3, :3] = Slerp([0, 1], turns)(share).as_matrix().T
    matrix[:3, 3] = -matrix[:3, :3] @ ((1 - share) * centers[0] + share * centers[1])
    return matrix


def pixel_of(point_m: Array, viewmat: Array, camera: PinholeCamera) -> tuple[float, float] | None:
    """Where a camera sees a point; None behind it."""
    x, y, z = camera.K @ (viewmat[:3, :3] @ point_m + viewmat[:3, 3])
    return (float(x / z), float(y / z)) if z > 0 else None


def point_at(pixel: tuple[float, float], depth_m: float, viewmat: Array, camera: PinholeCamera) -> Array:
    """[3] metres, what a camera sees at a pixel and a depth along its axis."""
    ray = np.linalg.solve(camera.K, [*pixel, 1.0]) * depth_m
    return viewmat[:3, :3].T @ (ray - viewmat[:3, 3])
