"""SPZ, Niantic's compressed splats: one file a view, a quarter of the PLY's size.

y is up, x right and z backward, which readers take for granted. The format has no room for where on Earth it is. Places
are rounded to 1/4096 m in 24 bits, and sizes end at exp(95 / 16) m: what is farther or larger is refused, since the
library would write something else without a word.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from aa4d.errors import InputError
from aa4d.export.clip import Y_UP, Clip, WorldGaussians, turned
from aa4d.export.forge import written
from aa4d.files import whole_file

FARTHEST_M = 2047.0
LARGEST_M = float(np.exp(95 / 16))


def export(clip: Clip, out: Path, progress: Callable[[int, int], None]) -> None:
    """`out`/NAME.spz for each view.

    Raises:
        InputError: nothing is drawn, or something lies beyond what the format holds.
    """
    for index in range(len(clip)):
        path = out / f"{clip.name(index)}.spz"
        if not path.exists():
            with whole_file(path) as temporary:
                gaussians = clip.some_gaussians(index)
                check_it_fits(gaussians)
                temporary.write_bytes(written(turned(gaussians, Y_UP), "spz"))
        progress(index + 1, len(clip))


def check_it_fits(gaussians: WorldGaussians) -> None:
    """Raises InputError where the format cannot hold a place or a size."""
    for what, values, most in (
        ("place", np.abs(gaussians.means), FARTHEST_M),
        ("size", gaussians.scales, LARGEST_M),
    ):
        if values.max() > most:
            raise InputError(
                f"--format spz: holds a {what} of at most {most:,.0f} m, and one is {values.max():,.0f} m; "
                "take sog or glb"
            )
