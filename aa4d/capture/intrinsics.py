"""Check of a camera that was given, before hours are spent on frames that it cannot have taken."""

from __future__ import annotations

from typing import Any

import numpy as np

from aa4d.errors import InputError

MOST_PX = 1_000_000  # along a side
SHORTEST_FOCAL, LONGEST_FOCAL = 0.01, 1000.0  # fractions of the longest side
MAX_CENTER_OUTSIDE = 1.0  # fraction of a side: the principal point may lie so far outside, as in cropped pictures
STEPS = 17  # from the principal point to the edge, at which a lens is looked at


def check_size(width: int, height: int, where: str) -> None:
    """`where` begins the sentence: a file, and what of it."""
    if not (0 < width <= MOST_PX and 0 < height <= MOST_PX):
        raise InputError(f"{where}: width and height (w, h) are {width}x{height}; expected 1 to {MOST_PX} pixels")


def check_intrinsics(camera: Any, where: str) -> None:
    """Raises InputError where no lens is like that of `camera` (COLMAP's)."""
    size = np.array([camera.width, camera.height], np.float64)
    check_size(camera.width, camera.height, where)
    focal = np.array([camera.focal_length_x, camera.focal_length_y])
    least, most = SHORTEST_FOCAL * size.max(), LONGEST_FOCAL * size.max()
    if not ((focal >= least) & (focal <= most)).all():
        raise InputError(
            f"{where}: the focal length (fl_x, fl_y) is {focal[0]:g}, {focal[1]:g}; expected {least:g} to {most:g} "
            f"pixels for pictures of {camera.width}x{camera.height}"
        )
    center = np.array([camera.principal_point_x, camera.principal_point_y])
    if not (np.abs(center / size - 0.5) <= 0.5 + MAX_CENTER_OUTSIDE).all():
        raise InputError(
            f"{where}: the principal point (cx, cy) is {center[0]:g}, {center[1]:g}, far outside of pictures of "
            f"{camera.width}x{camera.height}"
        )
    # The lens must spread what is ahead over the picture once: further out in the scene, further out in the picture.
    edge = size * [(x, y) for x in (0.0, 0.5, 1.0) for y in (0.0, 0.5, 1.0) if (x, y) != (0.5, 0.5)]
    rays = np.asarray(camera.cam_from_img(edge))
    shown = [np.asarray(camera.img_from_cam(np.column_stack([t * rays, np.ones(8)]))) for t in np.linspace(0, 1, STEPS)]
    outward = np.diff(np.linalg.norm(np.array(shown) - shown[0], axis=2), axis=0)
    if not ((outward > 0).all() and np.abs(shown[-1] - edge).max() < 1):
        raise InputError(f"{where}: no lens distorts like that ({camera.params_to_string()}); are the values in order?")
