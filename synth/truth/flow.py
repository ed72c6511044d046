"""Optical flow from depth, exact poses and the rigid motion of every instance.

Blender has a vector pass; it is float32 in world coordinates, takes no other frames than its neighbours, turns to
zeros under motion blur, and assumes a still world where an instance appears or goes. So the flow is computed here, in
float64, and the tests hold it against Blender's where Blender's is sound.
"""

import numpy as np
from numpy.typing import NDArray

from synth.camera import invert_rigid
from synth.truth.view import View

Array = NDArray[np.float64]

NEAREST_M = 0.1  # of what the camera shows: Blender's own near plane
# Of where a point lands: its distance from the axis over its depth. Beyond, a millionth of the depth (which is how well
# depth is known) shifts the place in the picture by pixels, and at the camera's plane by millions of them.
STEEPEST = 10.0


def flow(
    here: View, there: View, depth_z: NDArray[np.float32], instance_id: NDArray[np.uint32]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Displacement [H, W, 2] in pixels of what each pixel shows, from `here` to `there`, and where it is known [H, W].

    It is unknown (NaN) for an instance that is not in the scene at both instants and for what comes to lie behind the
    camera, at its plane or far outside the lens. What is infinitely far away moves with the rotation alone.
    """
    uv, _ = landing(here, there, depth_z, instance_id)
    width, height = here.size
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    moved = (uv - np.stack([x, y], axis=-1)).astype(np.float32)
    return moved, np.isfinite(moved).all(axis=-1)


def landing(
    here: View, there: View, depth_z: NDArray[np.float32], instance_id: NDArray[np.uint32]
) -> tuple[Array, Array]:
    """Where what each pixel shows is seen from `there`: pixel coordinates [H, W, 2] and planar depth [H, W]."""
    points = here.surface(depth_z)
    member = here.index_of(instance_id)
    if len(here.instance_id):
        there_row = there.index_of(here.instance_id)
        known = (there_row >= 0) & here.present & there.present[there_row]
        motion = there.object_to_world[there_row] @ invert_rigid(here.object_to_world)
        motion[~known] = np.nan
        on = member >= 0
        carried = motion[member[on]]
        points[on] = np.einsum("pij,pj->pi", carried[:, :3, :3], points[on]) + carried[:, :3, 3]
    points[(member < 0) & (instance_id > 0)] = np.nan  # an id that nobody has
    local = there.local(points)
    sky = np.isinf(depth_z)
    local[sky] = here.rays()[sky] @ here.viewmat[:3, :3] @ there.viewmat[:3, :3].T
    uv, depth = there.lens.project(local), local[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        aside = np.hypot(local[..., 0], local[..., 1]) / depth
        lost = (aside > _steepest(there)) | (~sky & (depth < NEAREST_M)) | (sky & (depth <= 0))
    uv[lost] = np.nan
    depth[sky] = np.where(depth[sky] > 0, np.inf, np.nan)
    return uv, depth


def _steepest(view: View) -> float:
    """Up to which distance from the axis, over the depth, a place in the picture is known."""
    corner = np.linalg.norm(view.lens.K[:2, 2] / np.diag(view.lens.K)[:2])
    return max(STEEPEST, 2 * float(corner))
