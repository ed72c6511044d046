"""One Gaussian by the wheel's C++, on numpy arrays: what can be tried where there is no torch."""

import numpy as np

from aa4d._native import raster

SIZE = 9


def floats(*values: object) -> np.ndarray:
    return np.array(values, np.float32)


def main() -> None:
    gaussian = {  # the scene keeps no array alive
        "means": floats([0, 0, 5]),
        "quaternions": floats([1, 0, 0, 0]),
        "scales": floats([1, 1, 1]),
        "opacities": floats(0.8),
        "colors": floats([0.9, 0.5, 0.1]),
        "background": floats(0, 0, 0),
    }
    scene = raster.Scene(**gaussian, features=None)
    K = np.array([[10, 0, SIZE / 2], [0, 10, SIZE / 2], [0, 0, 1]])
    camera = raster.PinholeCamera(np.eye(4), K, SIZE, SIZE, 0.01)
    color, alpha = np.zeros((SIZE, SIZE, 3), np.float32), np.zeros((SIZE, SIZE), np.float32)
    settings = raster.Settings(1 / 255, 1e-4, antialiased=False, mask_invalid=False, threads=1)
    raster.forward(scene, camera, settings, color, alpha, None, None, np.zeros(1, np.int32))
    np.testing.assert_allclose(alpha[SIZE // 2, SIZE // 2], 0.8, atol=1e-5)
    np.testing.assert_allclose(color[SIZE // 2, SIZE // 2], [0.72, 0.4, 0.08], atol=1e-5)


if __name__ == "__main__":
    main()
