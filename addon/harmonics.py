"""Spherical harmonics that say how a colour changes with the side it is seen from, as Blender's splats hold them.

The formulas of `aa4d/export/harmonics.py`: real harmonics with the signs of the original 3D Gaussian splatting, of the
direction from the eye to the Gaussian. No bpy here.
"""

import numpy as np

from .header import Doubles

HIGHEST = 3  # degree
SH_CONSTANT = 0.28209479177387814  # 1 / (2 sqrt(pi)), the constant harmonic
# Of the weights' sum, times (l (l + 1))^2 in degree l, which is the integral of the squared Laplacian: cameras on one
# arc leave most directions open, and there the smoothest function is taken.
SMOOTHNESS = 1e-6


def count(degree: int) -> int:
    """How many harmonics there are up to a degree."""
    return (degree + 1) ** 2


def degree_of(harmonics: int) -> int:
    """The degree up to which there are so many."""
    return round(harmonics**0.5) - 1


def basis(directions: Doubles, degree: int) -> Doubles:
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


def directions_from(eyes: Doubles, places: Doubles) -> Doubles:
    """[n, E, 3] unit vectors from each eye [E, 3] to each place [n, 3]."""
    away = places[:, None] - eyes
    return away / np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 1e-12)


def fitted(directions: Doubles, values: Doubles, weights: Doubles, degree: int) -> Doubles:
    """[n, (degree + 1)^2, 3] coefficients by weighted least squares, the smoothest ones where directions say nothing.

    `directions` [n, E, 3] unit, `values` [n, E, 3], `weights` [n, E] not negative. Without any weight they are 0.
    """
    harmonics = basis(directions, degree)
    weighted = (harmonics * weights[..., None]).transpose(0, 2, 1)
    band = np.repeat(np.arange(degree + 1), 2 * np.arange(degree + 1) + 1)
    total = weights.sum(axis=1)[:, None, None] + 1e-12
    stiffness = np.diag((band * (band + 1.0)) ** 2 * SMOOTHNESS + np.where(band == 0, 1e-12, 0))
    return np.linalg.solve(weighted @ harmonics + total * stiffness, weighted @ values)


def valued(coefficients: Doubles, directions: Doubles) -> Doubles:
    """[n, E, 3] the values of coefficients [n, C, 3] in directions [n, E, 3]."""
    return basis(directions, degree_of(coefficients.shape[1])) @ coefficients


def turned(coefficients: Doubles, rotation: Doubles) -> Doubles:
    """[n, C, 3] coefficients whose function is turned by [3, 3]: exact, since no degree mixes with another."""
    degree = degree_of(coefficients.shape[1])
    places = np.random.default_rng(0).normal(size=(4 * count(HIGHEST), 3))
    places /= np.linalg.norm(places, axis=1, keepdims=True)
    change = np.linalg.lstsq(basis(places @ rotation.T, degree), basis(places, degree), rcond=None)[0]
    return change @ coefficients
