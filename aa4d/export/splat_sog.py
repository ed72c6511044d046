"""SOG, PlayCanvas's splats as pictures in a ZIP archive: one file a view, for the web.

The identity of the export and the place on Earth lie in it as `aa4d.json`, beside the pictures.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from zipfile import ZipFile

from aa4d.export.clip import Clip
from aa4d.export.forge import written
from aa4d.files import whole_file

ABOUT = "aa4d.json"


def export(clip: Clip, out: Path, progress: Callable[[int, int], None]) -> None:
    """`out`/NAME.sog for each view."""
    about = {
        "identity": None if clip.identity is None else clip.identity.as_json(),
        "geographic_origin": None if clip.origin is None else dict(clip.origin),
    }
    for index in range(len(clip)):
        path = out / f"{clip.name(index)}.sog"
        if not path.exists():
            with whole_file(path) as temporary:
                temporary.write_bytes(written(clip.some_gaussians(index), "sog"))
                with ZipFile(temporary, "a") as archive:
                    archive.writestr(ABOUT, json.dumps(about))
        progress(index + 1, len(clip))
