"""Rotation vectors."""

import numpy as np
from numpy.typing import NDArray


def rotation(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation [3, 3] by |vector| radians about its direction (Rodrigues), exact at zero."""
    x, y, z = vector
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = float(np.linalg.norm(vector))
    # np.sinc(t) is sin(pi t) / (pi t); (1 - cos a) / a^2 is sinc(a / 2)^2 / 2 without the cancellation.
    turned = np.sinc(angle / np.pi) * skew + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * skew @ skew
    return np.asarray(np.eye(3) + turned)
