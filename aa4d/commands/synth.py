"""`aa4d synth`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg


def synth(
    scene: Annotated[Positional[Path], arg(help="Scene file, for instance scenes/crossroads.toml.")],
    out: Annotated[Path, arg(help="Folder for the capture: new, empty, or an unfinished capture of this scene.")],
) -> None:
    """Render a flyover with Blender: frames, exact poses, depth and ids, as a capture folder."""
    from aa4d.blender import run_in_blender

    code = run_in_blender("synth/render_flyover.py", str(scene), "--out", str(out))
    if code != 0:
        sys.exit(code if code > 0 else 1)
