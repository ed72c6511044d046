"""Whether what a pixel shows is seen at another instant too."""

import numpy as np
from numpy.typing import NDArray

from synth.truth.flow import landing
from synth.truth.view import View

SEEN, HIDDEN, OUTSIDE, UNKNOWN = range(4)
DEPTH_AGREEMENT = 0.003  # relative


def occlusion(
    here: View,
    there: View,
    depth_z: NDArray[np.float32],
    instance_id: NDArray[np.uint32],
    depth_there: NDArray[np.float32],
    id_there: NDArray[np.uint32],
) -> NDArray[np.uint8]:
    """Labels [H, W]: 0 seen, 1 hidden behind something, 2 outside the picture, 3 unknown (as the flow is).

    A point is seen where one of the four pixels around its place shows the same instance at the same depth, within
    0.3 % and what the depth changes from pixel to pixel on a slanted surface.
    """
    uv, depth = landing(here, there, depth_z, instance_id)
    width, height = there.size
    known = np.isfinite(uv).all(axis=-1)
    x, y = np.moveaxis(np.where(known[..., None], uv, -1.0), -1, 0)
    inside = known & (x >= 0) & (x < width) & (y >= 0) & (y < height)
    column, row = np.floor(x - 0.5).astype(np.int64), np.floor(y - 0.5).astype(np.int64)
    around = [(np.clip(row + j, 0, height - 1), np.clip(column + i, 0, width - 1)) for j in (0, 1) for i in (0, 1)]
    inverse = np.stack([1 / depth_there[at].astype(np.float64) for at in around])  # 0 in the sky
    same = np.stack([id_there[at] == instance_id for at in around])
    with np.errstate(invalid="ignore", divide="ignore"):
        wanted = 1 / depth
        # The slope between the pixels of the same instance; where it is a jump of depth, half a per cent is allowed.
        spread = np.where(same, inverse, np.nan)
        span = np.fmax.reduce(spread) - np.fmin.reduce(spread)
        allowed = DEPTH_AGREEMENT * wanted + np.minimum(np.nan_to_num(span), 0.02 * wanted)
        near = (same & (np.abs(inverse - wanted) <= allowed)).any(axis=0)
    labels = np.full(depth_z.shape, UNKNOWN, dtype=np.uint8)
    labels[known] = OUTSIDE
    labels[inside] = HIDDEN
    labels[inside & near] = SEEN
    return labels
