"""Splatting as docs/rasteriser.md has it, in float64 numpy, for Blenders without torch; a test holds it to ours."""

import numpy as np

DILATION, FAINTEST, MAX_ALPHA, NEAR = 0.3, 1 / 255, 0.99, 0.01  # px^2, and m


def splatted(
    camera: dict[str, np.ndarray],
    means: np.ndarray,
    covariances: np.ndarray,
    opacities: np.ndarray,
    colors: np.ndarray,
    background: np.ndarray,
) -> np.ndarray:
    """The picture [H, W, 3] of Gaussians with these means [N, 3] and covariances [N, 3, 3].

    `camera` has viewmat [4, 4] (OpenCV axes), K [3, 3] and size [2] (width, height). What lies outside the picture by
    more than 0.3 of half its side is not as ours has it.
    """
    rotation, translation = camera["viewmat"][:3, :3], camera["viewmat"][:3, 3]
    places = means @ rotation.T + translation
    width, height = camera["size"]
    pixels = np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=-1)
    picture, left = np.zeros((height, width, 3)), np.ones((height, width))
    focal, center = camera["K"].diagonal()[:2], camera["K"][:2, 2]
    for index in np.argsort(places[:, 2]):
        x, y, z = places[index]
        if z < NEAR:
            continue
        jacobian = focal[:, None] / z * np.array([[1, 0, -x / z], [0, 1, -y / z]])
        on_screen = jacobian @ rotation @ covariances[index] @ rotation.T @ jacobian.T + DILATION * np.eye(2)
        beside = pixels - (focal * [x, y] / z + center)
        distance = np.einsum("hwi,ij,hwj->hw", beside, np.linalg.inv(on_screen), beside)
        alpha = opacities[index] * np.exp(-distance / 2)
        alpha = np.where(alpha >= FAINTEST, np.minimum(alpha, MAX_ALPHA), 0)
        picture += (left * alpha)[..., None] * colors[index]
        left *= 1 - alpha
    return picture + left[..., None] * background


def covariances_of(quaternions: np.ndarray, scales: np.ndarray) -> np.ndarray:
    """[N, 3, 3] of unit quaternions [N, 4] w x y z and standard deviations [N, 3]."""
    w, x, y, z = quaternions.T
    rotations = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)
    half = rotations * scales[:, None, :]
    return half @ half.transpose(0, 2, 1)
