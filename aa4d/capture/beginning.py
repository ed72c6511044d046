"""The two frames that mapping begins with, and their poses, where the ground is nearly flat.

Two pictures of a plane have two explanations: the camera's motion, and another one, with a turn, that has the plane's
normal in its place. COLMAP decides for one, and of a drone that flies ahead it refuses the right one as a poor pair to
begin with. All later frames are then fitted to a world that bends, at an error that looks well enough. What stands
above the plane tells the two apart: the epipolar lines of the wrong one pass by it.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pycolmap
from numpy.typing import NDArray

from aa4d.capture.advice import FLAT
from aa4d.capture.colmap import opened

FLAT_SHARE = 0.5  # Share of the pairs: with less, COLMAP's own choice is no plane
LOOKED_AT = 60  # pairs, of all that have enough in common
FEWEST = 250  # points in common under one of these angles, the wider one first
ANGLES_DEG = (1.5, 0.7)
LEAST_ANGLE_DEG = ANGLES_DEG[-1]  # Mapping from such a pair takes points from here on: ahead, most angles are small
CLEARLY = 1.3  # times the better explanation's error is that of the other
PLANE_PX = 3.0  # distance from the plane's place
IN_FRONT = 0.9  # share of the points, for a motion that is possible

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Pair:
    """Two frames, by COLMAP's numbers and by file; the first's pose is the identity."""

    numbers: tuple[int, int]
    files: tuple[str, str]
    rotation: Floats  # [3, 3] from the first camera to the second
    translation: Floats  # [3] unit


def beginnings(database: Path, files: Collection[str]) -> list[Pair | None]:
    """Pairs of those frames to begin with, the more certain one first; None is COLMAP's own choice."""
    pair = of_a_plane(database, files)
    return [None] if pair is None else [pair, None]


def of_a_plane(database: Path, files: Collection[str]) -> Pair | None:
    """The pair with most points under a wide angle, of those that one motion explains clearly better than any other.

    None where no pair has FEWEST, or where most show more than a plane, so that COLMAP's own choice is as good.
    """
    with opened(database) as stored:
        camera = stored.read_all_cameras()[0]
        file_of = {image.image_id: image.name for image in stored.read_all_images() if image.name in files}
        numbers, geometries = stored.read_two_view_geometries()
        ids = [pycolmap.pair_id_to_image_pair(number) for number in numbers]
        common = [
            (pair, geometry)
            for pair, geometry in zip(ids, geometries, strict=True)
            if len(geometry.inlier_matches) and set(pair) <= file_of.keys()
        ]
        kinds = [pycolmap.TwoViewGeometryConfiguration(geometry.config).name for _, geometry in common]
        if sum(kind in FLAT for kind in kinds) <= FLAT_SHARE * len(common):
            return None
        enough = [(pair, g.inlier_matches) for pair, g in common if len(g.inlier_matches) >= FEWEST]
        chosen = enough[:: max(len(enough) // LOOKED_AT, 1)]
        points = {i: stored.read_keypoints(i)[:, :2] for i in {i for pair, _ in chosen for i in pair}}
    K = camera.calibration_matrix()
    clear: list[tuple[tuple[int, int], Floats, Floats, Floats]] = []
    for pair, matches in chosen:
        rays = [_rays(points[i][column], K) for i, column in zip(pair, matches.T, strict=True)]
        found = explained(rays[0], rays[1], PLANE_PX / K[0, 0])
        if found is not None and found[2] >= CLEARLY:
            clear.append((pair, *found[:2], _angles_deg(rays[0], rays[1], found[0])))
    for angle_deg in ANGLES_DEG:
        wide = [int((angles >= angle_deg).sum()) for *_, angles in clear]
        if max(wide, default=0) >= FEWEST:
            pair, rotation, translation, _ = clear[int(np.argmax(wide))]
            return Pair(pair, (file_of[pair[0]], file_of[pair[1]]), rotation, translation)
    return None


def explained(one: Floats, other: Floats, near: float) -> tuple[Floats, Floats, float] | None:
    """The motion between two pictures of a plane and what stands on it, and how many times worse the next best is.

    Args:
        one, other: rays [N, 3] of the same points from both cameras, at depth 1.
        near: distance at depth 1 within which a point is on the plane.

    Returns:
        Rotation [3, 3] and unit translation [3] from the first camera to the second; None where there is no plane, or
        one explanation only.
    """
    homography, _ = cv2.findHomography(one[:, :2], other[:, :2], cv2.RANSAC, near)
    if homography is None:
        return None
    _, rotations, translations, normals = cv2.decomposeHomographyMat(homography, np.eye(3))
    motions: list[tuple[float, Floats, Floats]] = []
    for turn, translation, normal in zip(rotations, translations, normals, strict=True):
        length = float(np.linalg.norm(translation))
        if length > 0 and (one @ normal > 0).mean() >= IN_FRONT:
            rotation, direction = np.asarray(turn, np.float64), np.asarray(translation[:, 0] / length, np.float64)
            motions.append((_epipolar_error(one, other, rotation, direction), rotation, direction))
    if len(motions) < 2:
        return None
    (error, rotation, direction), (next_best, *_) = sorted(motions, key=lambda motion: motion[0])[:2]
    return rotation, direction, next_best / max(error, 1e-12)


def _rays(pixels: Floats, K: Floats) -> Floats:
    homogeneous = np.column_stack([pixels, np.ones(len(pixels))])
    return np.asarray(homogeneous @ np.linalg.inv(K).T, np.float64)


def _epipolar_error(one: Floats, other: Floats, rotation: Floats, translation: Floats) -> float:
    """Mean distance of rays [N, 3] from each other's epipolar lines, to first order (Sampson)."""
    x, y, z = translation
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ rotation
    there, here = one @ essential.T, other @ essential
    slopes = (there[:, :2] ** 2).sum(axis=1) + (here[:, :2] ** 2).sum(axis=1)
    return float((np.abs((other * there).sum(axis=1)) / np.sqrt(np.maximum(slopes, 1e-12))).mean())


def _angles_deg(one: Floats, other: Floats, rotation: Floats) -> Floats:
    """[N] between the rays, the turn taken out."""
    turned = one @ rotation.T
    cosines = (turned * other).sum(axis=1) / np.linalg.norm(turned, axis=1) / np.linalg.norm(other, axis=1)
    return np.asarray(np.degrees(np.arccos(np.clip(cosines, -1, 1))))


def begun(pair: Pair, database: Path) -> Any:
    """A pycolmap.Reconstruction of the two frames, without points. Raises OSError where the disk is full."""
    with opened(database) as stored:
        camera = stored.read_all_cameras()[0]
    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(camera)
    poses = (pycolmap.Rigid3d(), pycolmap.Rigid3d(pycolmap.Rotation3d(pair.rotation), pair.translation))
    for number, file, pose in zip(pair.numbers, pair.files, poses, strict=True):
        image = pycolmap.Image(name=file, camera_id=camera.camera_id, image_id=number)
        model.add_image_with_trivial_frame(image, pose)
    return model
