"""The pair of frames that mapping begins with, where the ground is nearly flat.

Two pictures of a plane have two explanations: the camera's motion, and another one, with a turn, that has the plane's
normal in its place. COLMAP decides for one, and of a drone that flies ahead it refuses the right one as a poor pair to
begin with. All later frames are then fitted to a world that bends, at an error that looks well enough. Frames that show
enough beside the plane have one explanation only.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import pycolmap

from aa4d.capture.colmap import opened

PLANE = ("PLANAR", "PANORAMIC", "PLANAR_OR_PANORAMIC")  # kinds of two-view geometry, by COLMAP's names
MORE = ("CALIBRATED", "UNCALIBRATED")
FLAT_SHARE = 0.5  # of the pairs: with less, COLMAP's own choice is no plane


@dataclass(frozen=True)
class Pair:
    numbers: tuple[int, int]  # COLMAP's
    files: tuple[str, str]


def beginnings(database: Path, files: Collection[str]) -> list[Pair | None]:
    """Pairs of those frames to begin with, the more certain one first; None is COLMAP's own choice."""
    pair = beyond_the_plane(database, files)
    return [None] if pair is None else [pair, None]


def beyond_the_plane(database: Path, files: Collection[str]) -> Pair | None:
    """The pair with the most in common, of those that show more than one plane.

    None where there is none, or where most pairs do, so that COLMAP's own choice is as good.
    """
    with opened(database) as stored:
        file_of = {image.image_id: image.name for image in stored.read_all_images() if image.name in files}
        pairs, geometries = stored.read_two_view_geometries()
    flat, best = 0, None
    inliers: list[int] = []
    for pair, geometry in zip(pairs, geometries, strict=True):
        one, other = pycolmap.pair_id_to_image_pair(pair)
        kind = pycolmap.TwoViewGeometryConfiguration(geometry.config).name
        if kind not in PLANE + MORE or not {one, other} <= file_of.keys():
            continue
        flat += kind in PLANE
        if kind in MORE and len(geometry.inlier_matches) > max(inliers, default=0):
            best = Pair((one, other), (file_of[one], file_of[other]))
        inliers.append(0 if kind in PLANE else len(geometry.inlier_matches))
    return best if flat > FLAT_SHARE * len(inliers) else None
