"""Brown's lens: straight lines bend. The picture and every pass are taken from a wider pinhole picture.

Brown, "Close-range camera calibration", 1971; OpenCV's and COLMAP's OPENCV and FULL_OPENCV models.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from synth.checking import key
from synth.errors import InputError
from synth.lens import Lens, pixel_rays

STAGE = "lens"
COST = "the share by which the pinhole picture is wider, and a resampling"
TRUTH = "intrinsics, depth, ids, normals and flow follow; depth is corrected to the new ray on the surface's plane"

Array = NDArray[np.float64]
SUBDIVISION = 3  # the truth is rendered this much finer: its nearest pixel is at most a sixth of a pixel away
ITERATIONS = 12  # of Newton's method: squares the error each time


@dataclass(frozen=True, kw_only=True)
class Settings:
    k1: float = key("radial, second power", range=(-1, 1), default=-0.1)
    k2: float = key("radial, fourth power", range=(-1, 1), default=0.0)
    k3: float = key("radial, sixth power", range=(-1, 1), default=0.0)
    p1: float = key("tangential", range=(-0.2, 0.2), default=0.0)
    p2: float = key("tangential", range=(-0.2, 0.2), default=0.0)


@dataclass(frozen=True, eq=False)
class Brown:
    """`K`, the five coefficients, how much wider the pinhole picture is, and the widest radius that is mapped."""

    K: Array  # [3, 3]
    k1: float
    k2: float
    k3: float
    p1: float
    p2: float
    margin_px: tuple[int, int] = (0, 0)
    widest: float = np.inf

    def distort(self, xy: Array) -> Array:
        """Image plane at depth 1 [..., 2], without to with distortion."""
        x, y = xy[..., 0], xy[..., 1]
        r2 = x * x + y * y
        radial = 1 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))
        bent_x = x * radial + 2 * self.p1 * x * y + self.p2 * (r2 + 2 * x * x)
        bent_y = y * radial + self.p1 * (r2 + 2 * y * y) + 2 * self.p2 * x * y
        return np.stack([bent_x, bent_y], axis=-1)

    def jacobian(self, xy: Array) -> Array:
        """Derivative [..., 2, 2] of `distort`."""
        x, y = xy[..., 0], xy[..., 1]
        r2 = x * x + y * y
        radial = 1 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))
        slope = self.k1 + r2 * (2 * self.k2 + r2 * 3 * self.k3)
        cross = 2 * x * y * slope + 2 * self.p1 * x + 2 * self.p2 * y
        xx = radial + 2 * x * x * slope + 2 * self.p1 * y + 6 * self.p2 * x
        yy = radial + 2 * y * y * slope + 6 * self.p1 * y + 2 * self.p2 * x
        return np.stack([np.stack([xx, cross], axis=-1), np.stack([cross, yy], axis=-1)], axis=-2)

    def undistort(self, bent: Array) -> Array:
        """Inverse of `distort` by Newton's method."""
        xy = np.array(bent)
        for _ in range(ITERATIONS):
            off = self.distort(xy) - bent
            ((a, b), (c, d)) = np.moveaxis(self.jacobian(xy), (-2, -1), (0, 1))
            determinant = a * d - b * c
            xy -= (
                np.stack([d * off[..., 0] - b * off[..., 1], a * off[..., 1] - c * off[..., 0]], -1)
                / determinant[..., None]
            )
            if np.abs(off).max() < 1e-14:
                break
        return xy

    def project(self, local: Array) -> Array:
        depth = np.where(local[..., 2] > 0, local[..., 2], np.nan)
        xy = local[..., :2] / depth[..., None]
        xy = np.where((xy**2).sum(axis=-1, keepdims=True) > self.widest**2, np.nan, xy)
        return self.distort(xy) * np.diag(self.K)[:2] + self.K[:2, 2]

    def rays(self, uv: Array) -> Array:
        xy = self.undistort((uv - self.K[:2, 2]) / np.diag(self.K)[:2])
        return np.concatenate([xy, np.ones_like(xy[..., :1])], axis=-1)

    def document(self) -> dict[str, Any]:
        coefficients = {name: getattr(self, name) for name in ("k1", "k2", "k3", "p1", "p2")}
        return {"model": "OPENCV", "K": self.K.tolist(), "distortion": coefficients}


def lens(settings: Settings, K: Array, size: tuple[int, int]) -> Brown:
    """The lens for pictures of `size` (width, height), with the margin that its pinhole picture needs.

    Raises:
        InputError: the coefficients fold the picture over itself, or need a picture over twice as wide.
    """
    width, height = size
    brown = Brown(K, settings.k1, settings.k2, settings.k3, settings.p1, settings.p2)
    across, down = np.linspace(0, width, 65), np.linspace(0, height, 65)
    uv = np.stack(np.meshgrid(across, down), axis=-1)
    with np.errstate(all="ignore"):
        xy, bent = brown.rays(uv)[..., :2], (uv - K[:2, 2]) / np.diag(K)[:2]
        sound = np.linalg.det(brown.jacobian(xy)).min() > 0.05 and np.abs(brown.distort(xy) - bent).max() < 1e-9
    if not sound:  # NaN is not
        raise InputError("effects.lens_distortion: these coefficients fold the picture over itself; take smaller ones.")
    straight = xy * np.diag(K)[:2] + K[:2, 2]
    beyond = np.maximum(-straight.min(axis=(0, 1)), straight.max(axis=(0, 1)) - [width, height])
    margin = tuple(int(np.ceil(max(0.0, b))) + 2 for b in beyond)  # 2: the resampling filter's reach
    if margin[0] > width // 2 or margin[1] > height // 2:
        raise InputError("effects.lens_distortion: the pinhole picture would be over twice as wide; take less.")
    widest = 1.05 * float(np.sqrt((xy**2).sum(axis=-1).max()))
    return Brown(K, settings.k1, settings.k2, settings.k3, settings.p1, settings.p2, margin, widest)  # type: ignore[arg-type]


def picture(lens: Lens, wide: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """The picture [H, W, C] through the lens, from the wide pinhole picture: Catmull-Rom in linear light."""
    at = _wide_position(lens, size) - 0.5
    corner = np.floor(at).astype(np.int64)
    x, y = (_catmull_rom(t) for t in np.moveaxis(at - corner, -1, 0))  # [4, H, W] each
    result = np.zeros((size[1], size[0], wide.shape[2]))
    for j in range(4):
        row = np.clip(corner[..., 1] + j - 1, 0, wide.shape[0] - 1)
        line = sum(x[i][..., None] * wide[row, np.clip(corner[..., 0] + i - 1, 0, wide.shape[1] - 1)] for i in range(4))
        result += y[j][..., None] * line
    return np.maximum(result, 0).astype(np.float32)  # the filter undershoots beside what is bright


def truth(lens: Lens, wide: dict[str, NDArray[Any]], size: tuple[int, int], rotation: Array) -> dict[str, NDArray[Any]]:
    """Passes through the lens: those of the nearest pinhole pixel; depth moves along its plane to the new ray.

    `wide` holds depth_z, normal (world) and others, `SUBDIVISION` times finer than the wide picture; `rotation` [3, 3]
    takes world to camera.
    """
    column, row = np.moveaxis(np.floor(SUBDIVISION * _wide_position(lens, size)).astype(np.int64), -1, 0)
    found = {name: values[row, column] for name, values in wide.items()}
    focal, centre = SUBDIVISION * np.diag(lens.K)[:2], SUBDIVISION * (lens.K[:2, 2] + lens.margin_px)
    nearest = (np.stack([column, row], axis=-1) + 0.5 - centre) / focal
    nearest = np.concatenate([nearest, np.ones_like(nearest[..., :1])], axis=-1)
    wanted = pixel_rays(lens, size)
    normal = found["normal"].astype(np.float64) @ rotation.T
    facing, facing_wanted = (normal * nearest).sum(axis=-1), (normal * wanted).sum(axis=-1)
    steep = np.abs(facing_wanted) < 0.05  # seen edge-on, the plane says nothing about half a pixel beside it
    ratio = np.where(steep, 1.0, facing / np.where(steep, 1.0, facing_wanted))
    found["depth_z"] = (found["depth_z"] * np.clip(ratio, 0.9, 1.1)).astype(np.float32)
    return found


def _wide_position(lens: Lens, size: tuple[int, int]) -> Array:
    """Where in the wide picture the pixels of the picture look [H, W, 2]."""
    return pixel_rays(lens, size)[..., :2] * np.diag(lens.K)[:2] + lens.K[:2, 2] + lens.margin_px


def _catmull_rom(t: Array) -> tuple[Array, ...]:
    return (
        ((-0.5 * t + 1) * t - 0.5) * t,
        (1.5 * t - 2.5) * t * t + 1,
        ((-1.5 * t + 2) * t + 0.5) * t,
        (0.5 * t - 0.5) * t * t,
    )
