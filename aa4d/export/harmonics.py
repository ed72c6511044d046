"""View-dependent colors as spherical harmonics, which splat formats hold, fitted over the capture's cameras.

The real harmonics with the signs of the original 3D Gaussian splatting, which PLY, SPZ, SOG, glTF, USD and Blender
share. A color is 0.5 + sum(coefficient * harmonic), of the direction from the eye to the Gaussian.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

HIGHEST = 3
SH_CONSTANT = 0.28209479177387814  # 1 / (2 sqrt(pi)), the constant harmonic
# Of the weights' sum, times (l (l + 1))^2 in degree l, which is the integral of the squared Laplacian: cameras on one
# arc leave most directions open, and there the smoothest function is taken.
SMOOTHNESS = 1e-6
ROWS = 4096  # Gaussians that are solved at once


def count(degree: int) -> int:
    """How many harmonics there are up to a degree."""
    return (degree + 1) ** 2


def degrees(degree: int) -> NDArray[np.int64]:
    """[(degree + 1)^2] the degree of each harmonic."""
    return np.repeat(np.arange(degree + 1), 2 * np.arange(degree + 1) + 1)


def basis(directions: Array, degree: int) -> Array:
    """[..., (degree + 1)^2] the harmonics of unit vectors [..., 3]."""
    x, y, z = np.moveaxis(directions, -1, 0)
    xx, yy, zz = x * x, y * y, z * z
    columns = [np.full_like(x, SH_CONSTANT)]
    if degree > 0:
        columns += [-0.4886025119029199 * y, 0.4886025119029199 * z, -0.4886025119029199 * x]
    if degree > 1:
        columns += [
            1.0925484305920792 * x * y,
            -1.0925484305920792 * y * z,
            0.31539156525252005 * (2 * zz - xx - yy),
            -1.0925484305920792 * x * z,
            0.5462742152960396 * (xx - yy),
        ]
    if degree > 2:
        columns += [
            -0.5900435899266435 * y * (3 * xx - yy),
            2.890611442640554 * x * y * z,
            -0.4570457994644658 * y * (4 * zz - xx - yy),
            0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
            -0.4570457994644658 * x * (4 * zz - xx - yy),
            1.445305721320277 * z * (xx - yy),
            -0.5900435899266435 * x * (xx - 3 * yy),
        ]
    return np.stack(columns, axis=-1)


def directions_from(eyes: Array, means: Array) -> Array:
    """[N, E, 3] unit vectors from each eye [E, 3] to each Gaussian [N, 3]."""
    away = means[:, None] - eyes
    return away / np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 1e-12)


def fitted(directions: Array, colors: Array, weights: Array, degree: int) -> Array:
    """[N, (degree + 1)^2, 3] coefficients by weighted least squares, the smoothest ones where directions say nothing.

    `directions` [N, E, 3] unit, `colors` [N, E, 3], `weights` [N, E] of what is seen from there, not negative. A
    Gaussian without any weight is grey.
    """
    harmonics = basis(directions, degree)
    weighted = harmonics * weights[..., None]
    band = degrees(degree)
    total = weights.sum(axis=1)[:, None, None] + 1e-12
    stiffness = np.diag((band * (band + 1.0)) ** 2 * SMOOTHNESS + np.where(band == 0, 1e-12, 0))
    normal = np.einsum("nec,ned->ncd", weighted, harmonics) + total * stiffness
    return np.linalg.solve(normal, np.einsum("nec,nek->nck", weighted, colors - 0.5))


def shown(coefficients: Array, directions: Array) -> Array:
    """[N, ..., 3] the colors that coefficients [N, C, 3] have in directions [N, ..., 3], in [0, 1]."""
    degree = round(np.sqrt(coefficients.shape[1])) - 1
    return np.clip(0.5 + np.einsum("n...c,nck->n...k", basis(directions, degree), coefficients), 0, 1)


def turned(coefficients: Array, rotation: Rotation) -> Array:
    """[N, C, 3] coefficients whose function is turned with the world: exact, since no degree mixes with another."""
    degree = round(np.sqrt(coefficients.shape[1])) - 1
    places = np.random.default_rng(0).normal(size=(4 * count(HIGHEST), 3))
    places /= np.linalg.norm(places, axis=1, keepdims=True)
    change = np.linalg.lstsq(basis(rotation.apply(places), degree), basis(places, degree), rcond=None)[0]
    return np.einsum("dc,nck->ndk", change, coefficients)


@dataclass(frozen=True)
class Sights:
    """What E eyes see of N Gaussians at one instant."""

    eyes: Array  # [E, 3] metres
    colors: Array  # [N, E, 3] sRGB in [0, 1]
    opacities: Array  # [N, E] in [0, 1]

    def fit(self, means: Array, degree: int) -> Array:
        """[N, (degree + 1)^2, 3] coefficients; what is opaque from an eye counts there."""
        return np.concatenate(
            [
                fitted(directions_from(self.eyes, means[rows]), self.colors[rows], self.opacities[rows], degree)
                for rows in self._parts()
            ]
        )

    def error(self, means: Array, coefficients: Array) -> float:
        """The root of the mean square by which these colors are off, over eyes and channels, weighted by opacity."""
        squares = 0.0
        for rows in self._parts():
            off = shown(coefficients[rows], directions_from(self.eyes, means[rows])) - self.colors[rows]
            squares += float((self.opacities[rows][..., None] * off**2).sum())
        return float(np.sqrt(squares / max(3 * self.opacities.sum(), 1e-12)))

    def _parts(self) -> list[slice]:
        return [slice(start, start + ROWS) for start in range(0, max(len(self.colors), 1), ROWS)]
