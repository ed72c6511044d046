"""A point of one frame, found on the surface that another frame shows there, and brought back."""

import numpy as np
from numpy.typing import NDArray

from synth.camera import invert_rigid
from synth.truth.flow import landing
from synth.truth.recording import Recording

Array = NDArray[np.float64]
FLAT = 2e-5  # share of the depth by which the fourth pixel may be off the plane of the other three
BESIDE = ((-1, 0), (2, 1), (1, -1), (0, 2))  # row, column: above, below, left and right of the four pixels
NO_FOLD = 2e-4  # the same for those beside: so loose that depth which is bent everywhere is still looked at
GRAZING = 0.1  # sine of the flattest view of a plane that counts
SAME_SURFACE = 0.004  # share of the depth: farther, it is something else that is in front


def round_trip(recording: Recording, a: int, b: int) -> tuple[Array, NDArray[np.bool_], float]:
    """Pixels [P] between where points are in frame a and where they come back to by way of frame b, which of them are
    on instances [P], and the share of the points on planes that are not found again: hidden, or the truth is wrong.

    A pixel of a is carried to b by its depth, the poses and the motion of its instance. There the four pixels around
    and one more on each side must be on one plane of one instance (four alone are on one across every fold that runs
    along a row or a column); the ray meets that plane in a point, which is carried back.
    """
    here, there = recording.view(a), recording.view(b)
    truth_a, truth_b = recording.truth(a), recording.truth(b)
    ids = truth_a["instance_id"]
    uv, depth = landing(here, there, truth_a["depth_z"], ids)
    width, height = here.size
    with np.errstate(invalid="ignore"):
        inside = np.isfinite(depth) & ((uv >= 2) & (uv < [width - 2, height - 2])).all(axis=-1)
    row_a, column_a = np.nonzero(inside)
    uv, depth, ids = uv[inside], depth[inside], ids[inside]
    column, row = np.floor(uv - 0.5).astype(np.int64).T

    surface = there.surface(truth_b["depth_z"])
    p = [[surface[row + j, column + i] for i in (0, 1)] for j in (0, 1)]
    normal = np.cross(p[0][1] - p[0][0], p[1][0] - p[0][0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)

    def off_plane(point: Array) -> Array:
        return np.abs(((point - p[0][0]) * normal).sum(axis=1))

    flat_here = off_plane(p[1][1]) < FLAT * depth
    for j, i in BESIDE:
        flat_here &= off_plane(surface[row + j, column + i]) < NO_FOLD * depth
    same = np.all([truth_b["instance_id"][row + j, column + i] == ids for j in (0, 1) for i in (0, 1)], axis=0)

    eye = recording.eye(b)
    ray = there.lens.rays(uv) @ there.viewmat[:3, :3]
    facing = (ray * normal).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        met = ((p[0][0] - eye) * normal).sum(axis=1) / facing
        seen = same & flat_here & (np.abs(facing) > GRAZING * np.linalg.norm(ray, axis=1))
        flat = seen.sum()
        seen &= np.abs(met / depth - 1) < SAME_SURFACE
    found = eye + ray[seen] * met[seen, None]

    member = here.index_of(ids[seen])
    back = here.object_to_world @ invert_rigid(there.object_to_world)
    on = member >= 0
    found[on] = np.einsum("pij,pj->pi", back[member[on], :3, :3], found[on]) + back[member[on], :3, 3]
    returned, _ = here.project(found)
    start = np.stack([column_a, row_a], axis=-1)[seen] + 0.5
    lost = 1 - seen.sum() / flat if flat else 0.0
    return np.linalg.norm(returned - start, axis=1), on, float(lost)
