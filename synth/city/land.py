"""The land around the scene, out to the horizon: only where a frame would look beyond the scene's own ground."""

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from synth.camera import invert_rigid
from synth.city.mesh import Mesh
from synth.streets.ground import BEYOND_M

Array = NDArray[np.float64]
RING, PIECES = 2.0, 4  # each ring of the land is twice as wide as the one inside, and of small pieces: float32 is exact
# to a share of a piece's size, and at a grazing view that error grows to one of the depth
OUTERMOST_M = 1e7
END_PX = 0.05  # of the end of the land under the horizon, at most
MARGIN_PX = 3.0  # what filters and blur look at beside the picture


def looks_beyond(viewmats: Array, K: Array, size: tuple[float, float], margin_px: tuple[float, float]) -> bool:
    """Whether a camera [N, 4, 4] sees farther than the scene's ground, the square of side 2 `BEYOND_M` around the
    origin: a corner of its picture (width, height), with a margin on each side, does not look at it."""
    across, down = (margin + MARGIN_PX for margin in margin_px)
    x, y = np.meshgrid([-across, size[0] + across], [-down, size[1] + down])
    rays = np.stack([(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], np.ones_like(x)], axis=-1).reshape(-1, 3)
    poses = invert_rigid(viewmats)
    directions = np.einsum("nij,rj->nri", poses[:, :3, :3], rays)
    eyes = poses[:, None, :3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = eyes[..., 2] / -directions[..., 2]
        met = eyes[..., :2] + along[..., None] * directions[..., :2]
    inside = (directions[..., 2] < 0) & (np.abs(met) < BEYOND_M).all(axis=-1)
    return bool((~inside).any() or (np.abs(eyes[..., :2]) >= BEYOND_M).any())


def land(highest_m: float, pixel_rad: float) -> Mesh:
    """Level ground from the scene's own outwards, so far that seen from `highest_m` its end is `END_PX`
    under the horizon at most."""
    end = min(max(highest_m, 1.0) / math.tan(END_PX * pixel_rad), OUTERMOST_M)
    mesh, inner = Mesh(), BEYOND_M
    while inner < end:
        outer = RING * inner
        for turn in range(4):
            for a, b in itertools.pairwise(np.linspace(-1.0, 1.0, PIECES + 1)):
                quad = [(inner, a * inner), (outer, a * outer), (outer, b * outer), (inner, b * inner)]
                for _ in range(turn):
                    quad = [(-y, x) for x, y in quad]
                mesh.polygon([(x, y, 0.0) for x, y in quad], "land")
        inner = outer
    return mesh
