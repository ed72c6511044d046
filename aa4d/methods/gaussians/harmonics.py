"""Real spherical harmonics to degree 3: colors that depend on the direction from which they are seen.

Signs and order are those of 3DGS and of the splat files that follow it. The basis is orthonormal over the sphere.
"""

from __future__ import annotations

from math import pi, sqrt

import torch
from torch import Tensor

LARGEST_DEGREE = 3
C0 = 0.5 / sqrt(pi)
C1 = sqrt(3 / (4 * pi))
# Of xy, yz, 2zz - xx - yy, xz, xx - yy.
C2 = (
    0.5 * sqrt(15 / pi),
    -0.5 * sqrt(15 / pi),
    0.25 * sqrt(5 / pi),
    -0.5 * sqrt(15 / pi),
    0.25 * sqrt(15 / pi),
)
# Of y(3xx - yy), xyz, y(4zz - xx - yy), z(2zz - 3xx - 3yy), x(4zz - xx - yy), z(xx - yy), x(xx - 3yy).
C3 = (
    -0.25 * sqrt(35 / (2 * pi)),
    0.5 * sqrt(105 / pi),
    -0.25 * sqrt(21 / (2 * pi)),
    0.25 * sqrt(7 / pi),
    -0.25 * sqrt(21 / (2 * pi)),
    0.25 * sqrt(105 / pi),
    -0.25 * sqrt(35 / (2 * pi)),
)


def count_of(degree: int) -> int:
    """Coefficients up to a degree."""
    return (degree + 1) ** 2


def basis(direction: Tensor, degree: int) -> Tensor:
    """Values [N, (degree + 1)^2] at unit directions [N, 3]."""
    x, y, z = direction.unbind(1)
    values = [torch.full_like(x, C0)]
    if degree > 0:
        values += [-C1 * y, C1 * z, -C1 * x]
    if degree > 1:
        xx, yy, zz = x * x, y * y, z * z
        values += [
            C2[0] * x * y,
            C2[1] * y * z,
            C2[2] * (2 * zz - xx - yy),
            C2[3] * x * z,
            C2[4] * (xx - yy),
        ]
    if degree > 2:
        values += [
            C3[0] * y * (3 * xx - yy),
            C3[1] * x * y * z,
            C3[2] * y * (4 * zz - xx - yy),
            C3[3] * z * (2 * zz - 3 * xx - 3 * yy),
            C3[4] * x * (4 * zz - xx - yy),
            C3[5] * z * (xx - yy),
            C3[6] * x * (xx - 3 * yy),
        ]
    return torch.stack(values, dim=1)


def colors_of(coefficients: Tensor, direction: Tensor, degree: int) -> Tensor:
    """sRGB [N, 3], at least 0, of coefficients [N, B, 3] with B of at least (degree + 1)^2, seen along [N, 3]."""
    used = coefficients[:, : count_of(degree)]
    return (torch.bmm(basis(direction, degree)[:, None], used)[:, 0] + 0.5).clamp_min(0)


def constant_of(color: Tensor) -> Tensor:
    """The first coefficient [..., 3] of a color that is the same from everywhere."""
    return (color - 0.5) / C0
