"""Distance of cameras from the true ones, after the best similarity: a reconstruction chooses its own world.

Four points a camera are aligned, its centre and three corners of what it sees at the viewing distance, so that
rotations count too and a straight flight does not leave a roll about itself free (centres alone: Umeyama 1991).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aa4d.capture.orientation import Similarity, umeyama

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PoseError:
    trajectory_m: float  # root mean square distance of centres (absolute trajectory error)
    rotation_deg: float  # root mean square angle
    to_truth: Similarity


def pose_error(found: Floats, truth: Floats, distance_m: float) -> PoseError:
    """
    Args:
        found, truth: world to camera [N, 4, 4], of the same frames.
        distance_m: from cameras to what they see, in the truth's world.
    """
    # In the found world, the same distance: as the flights' sizes compare, refined by the alignment itself.
    similarity = umeyama(_centers(found), _centers(truth)) if len(found) > 2 else Similarity(1, np.eye(3), np.zeros(3))
    for _ in range(3):
        points = _seen(found, distance_m / similarity.scale)
        similarity = umeyama(points, _seen(truth, distance_m))
    apart = np.linalg.norm(similarity.of_points(_centers(found)) - _centers(truth), axis=1)
    turned = found[:, :3, :3] @ similarity.rotation.T
    difference = np.einsum("nij,nkj->nik", turned, truth[:, :3, :3])
    # By the antisymmetric part, which small angles do not lose digits in, as the cosine does.
    sine = 0.5 * np.linalg.norm(
        np.stack([difference[:, 2, 1], difference[:, 0, 2], difference[:, 1, 0]], -1)
        - np.stack([difference[:, 1, 2], difference[:, 2, 0], difference[:, 0, 1]], -1),
        axis=1,
    )
    cosine = 0.5 * (np.trace(difference, axis1=1, axis2=2) - 1)
    angle = np.degrees(np.arctan2(sine, cosine))
    return PoseError(float(np.sqrt((apart**2).mean())), float(np.sqrt((angle**2).mean())), similarity)


def in_other_world(viewmats: Floats, similarity: Similarity) -> Floats:
    """Cameras [N, 4, 4] after the world has moved by `similarity`: they see the moved world as they saw it."""
    moved = np.tile(np.eye(4), (len(viewmats), 1, 1))
    moved[:, :3, :3] = viewmats[:, :3, :3] @ similarity.rotation.T
    centers = similarity.of_points(_centers(viewmats))
    moved[:, :3, 3] = -np.einsum("nij,nj->ni", moved[:, :3, :3], centers)
    return moved


def inverse(similarity: Similarity) -> Similarity:
    rotation = similarity.rotation.T
    return Similarity(1 / similarity.scale, rotation, -rotation @ similarity.translation / similarity.scale)


def _centers(viewmats: Floats) -> Floats:
    centers: Floats = -np.einsum("nji,nj->ni", viewmats[:, :3, :3], viewmats[:, :3, 3])
    return centers


def _seen(viewmats: Floats, distance: float) -> Floats:
    """[4 N, 3] each camera's centre and three points at that distance, half as far to the sides."""
    in_camera = distance * np.array([[0, 0, 0], [0.5, 0, 1], [-0.25, 0.43, 1], [-0.25, -0.43, 1]])
    points = np.einsum("nji,pj->npi", viewmats[:, :3, :3], in_camera) + _centers(viewmats)[:, None]
    seen: Floats = points.reshape(-1, 3)
    return seen
