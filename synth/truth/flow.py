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


def flow(
    here: View, there: View, depth_z: NDArray[np.float32], instance_id: NDArray[np.uint32]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Displacement [H, W, 2] in pixels of what each pixel shows, from `here` to `there`, and where it is known [H, W].

    It is unknown (NaN) for an instance that is not in the scene at both instants and for what comes to lie behind the
    camera or far outside the lens. What is infinitely far away moves with the rotation alone.
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
    uv, depth = there.project(points)
    sky = np.isinf(depth_z)
    turned = here.rays()[sky] @ here.viewmat[:3, :3] @ there.viewmat[:3, :3].T
    uv[sky], depth[sky] = there.lens.project(turned), np.where(turned[:, 2] > 0, np.inf, np.nan)
    return uv, depth
