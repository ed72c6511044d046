"""The 4DGS container (package fourdgs): one file that its players seek in by time.

It stores Gaussians that live for a while and move along straight lines. Between two views each Gaussian is one that
lives from the first to the second and moves from its place in the first to that in the second; everything else about
it is as in the first. The library quantises within bounds that it states in the file.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import fourdgs
import numpy as np

from aa4d import __version__
from aa4d.export.clip import Array, Clip, WorldGaussians
from aa4d.files import whole_file

NAME = "scene.4dgs"
# Of the format's registry: handedness, up axis, forward axis; length unit.
RIGHT_HANDED_Z_UP_Y_FORWARD = (1, 2, 1)
METRE = 1


def export(clip: Clip, out: Path, progress: Callable[[int, int], None]) -> None:
    """`out`/scene.4dgs; a view's place on its clock is `Clip.seconds`, and the last one lasts one frame."""
    path = out / NAME
    if path.exists():
        progress(len(clip), len(clip))
        return
    parts: list[dict[str, Array]] = []
    after = clip.gaussians(0)
    for index in range(len(clip)):
        now, after = after, clip.gaussians(min(index + 1, len(clip) - 1))
        parts.append(_slot(now, after, clip.seconds(index), clip.seconds(index + 1)))
        progress(index + 1, len(clip))
    columns = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
    wide = {"win_lo", "win_hi"}  # the file keeps these in float64
    scene = fourdgs.GaussianSet(**{k: v if k in wide else v.astype(np.float32) for k, v in columns.items()})
    frame = fourdgs.CoordinateFrame("", *RIGHT_HANDED_Z_UP_Y_FORWARD, METRE, 1.0)
    # The library's own converters to USD and glTF read the axes here, not in the provenance.
    metadata = {"coordinate_system": "z-up-right-handed"}
    if clip.identity is not None:
        metadata["aa4d"] = clip.identity.as_text()
    if clip.origin is not None:
        metadata["geographic_origin"] = json.dumps(dict(clip.origin))
    provenance = fourdgs.Provenance(frames=[frame])
    options = fourdgs.WriteOptions(library=f"aa4d {__version__}", provenance=provenance, metadata=metadata)
    with whole_file(path) as temporary:
        fourdgs.write(str(temporary), scene, clip.seconds(len(clip)), options=options)


def _slot(now: WorldGaussians, after: WorldGaussians, start_s: float, end_s: float) -> dict[str, Array]:
    """The Gaussians of `now`, living in [start_s, end_s) and moving to where `after` has them."""
    n = len(now.ids)
    velocity = np.zeros((n, 3))
    _, rows, rows_after = np.intersect1d(now.ids, after.ids, assume_unique=True, return_indices=True)
    velocity[rows] = (after.means[rows_after] - now.means[rows]) / (end_s - start_s)
    middle = (start_s + end_s) / 2
    return {
        "positions": now.means + velocity * (middle - start_s),
        "scales": now.scales,
        "rotations": now.quaternions[:, [1, 2, 3, 0]],  # x y z w there
        "colors": np.concatenate([now.colors, now.opacities[:, None]], axis=1),
        "motions": velocity,
        "mu_t": np.full(n, middle),
        "sigma_t": np.full(n, np.inf),  # no fading within its life
        "win_lo": np.full(n, start_s),
        "win_hi": np.full(n, end_s),
    }
