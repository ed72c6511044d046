"""SPZ, Niantic's compressed splats: one file a view, a tenth of the PLY's size.

y is up, x right and z backward, which readers take for granted. The format has no room for where on Earth it is.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from aa4d.export.clip import Y_UP, Clip, turned
from aa4d.export.forge import written
from aa4d.files import whole_file


def export(clip: Clip, out: Path, progress: Callable[[int, int], None]) -> None:
    """`out`/NAME.spz for each view."""
    for index in range(len(clip)):
        path = out / f"{clip.name(index)}.spz"
        if not path.exists():
            with whole_file(path) as temporary:
                temporary.write_bytes(written(turned(clip.gaussians(index), Y_UP), "spz"))
        progress(index + 1, len(clip))
