"""The pinhole camera: intrinsics, poses, projection. OpenCV axes; pixel (i, j) has its centre at (i + 0.5, j + 0.5)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from synth.checking import key

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Camera:
    """A pinhole with square pixels and a centred lens."""

    width_px: int = key("width of a frame", unit="pixels", range=(16, 8192))
    height_px: int = key("height of a frame", unit="pixels", range=(16, 8192))
    hfov_deg: float = key("horizontal field of view", unit="degrees", range=(5, 150))


OPENCV_TO_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])  # flips y and z of the camera's axes


def intrinsics(camera: Camera) -> Array:
    """K [3, 3] in pixels of a centred lens with square pixels."""
    focal = 0.5 * camera.width_px / np.tan(0.5 * np.radians(camera.hfov_deg))
    return np.array([[focal, 0, 0.5 * camera.width_px], [0, focal, 0.5 * camera.height_px], [0, 0, 1]])


def invert_rigid(matrix: Array) -> Array:
    """Inverse [..., 4, 4] of rigid transforms, exact to rounding."""
    rotation = np.swapaxes(matrix[..., :3, :3], -1, -2)
    inverse = np.zeros_like(matrix)
    inverse[..., :3, :3] = rotation
    inverse[..., :3, 3] = -np.einsum("...ij,...j->...i", rotation, matrix[..., :3, 3])
    inverse[..., 3, 3] = 1
    return inverse


def project(points: Array, viewmat: Array, K: Array) -> tuple[Array, Array]:
    """Pixel coordinates [..., 2] and planar depth [...] of world points [..., 3]."""
    local = points @ viewmat[:3, :3].T + viewmat[:3, 3]
    depth = local[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        uv = local[..., :2] / depth[..., None] * np.array([K[0, 0], K[1, 1]]) + K[:2, 2]
    return uv, depth


def unproject(uv: Array, depth: Array, viewmat: Array, K: Array) -> Array:
    """World points [..., 3] at pixel coordinates [..., 2] and planar depth [...]."""
    rays = (uv - K[:2, 2]) / np.array([K[0, 0], K[1, 1]])
    local = np.concatenate([rays, np.ones_like(rays[..., :1])], axis=-1) * depth[..., None]
    return (local - viewmat[:3, 3]) @ viewmat[:3, :3]


def pixel_centres(width: int, height: int) -> Array:
    """Coordinates [H, W, 2] of the centres of all pixels."""
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    return np.stack([x, y], axis=-1)


def quaternion(rotation: Array) -> Array:
    """Unit quaternion w x y z of a rotation matrix [3, 3], w >= 0, by the largest of its four components."""
    r = rotation
    # Four times the products of the components with each other: the row with the largest diagonal is well conditioned.
    products = np.array(
        [
            [1 + r[0, 0] + r[1, 1] + r[2, 2], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], 1 + r[0, 0] - r[1, 1] - r[2, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]],
            [r[0, 2] - r[2, 0], r[0, 1] + r[1, 0], 1 - r[0, 0] + r[1, 1] - r[2, 2], r[1, 2] + r[2, 1]],
            [r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], 1 - r[0, 0] - r[1, 1] + r[2, 2]],
        ]
    )
    row = products[np.argmax(np.diag(products))]
    row = row / np.linalg.norm(row)
    return row if row[0] >= 0 else -row


def same_hemisphere(quaternions: Array) -> Array:
    """Quaternions [N, 4] with signs chosen so that each is in the hemisphere of the one before."""
    dots = np.einsum("ij,ij->i", quaternions[1:], quaternions[:-1])
    signs = np.cumprod(np.concatenate([[1.0], np.where(dots < 0, -1.0, 1.0)]))
    return quaternions * signs[:, None]
