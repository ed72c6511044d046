"""A folder that a command fills file by file, and may continue to fill when it is run again."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from aa4d.errors import InputError
from aa4d.files import make_folder, read_json_object, write_json


def claim_folder(out: Path, index_name: str, wanted: dict[str, Any], what: str) -> dict[str, Any]:
    """The index of what `out` holds, written first: a folder is new, empty, or this very output.

    Args:
        wanted: everything that the files depend on; further keys of an index that is there are its own.
        what: "render", for messages.

    Raises:
        InputError: `out` holds something else.
    """
    path = out / index_name
    if path.exists():
        found = read_json_object(path, f"the index of {what}")
        if any(found.get(key) != value for key, value in wanted.items()):
            raise InputError(f"{out}: holds {what} with other settings; choose another --out, or delete that folder")
        return found
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out}: not empty and not {what}; choose a new folder with --out")
    make_folder(out)
    write_json(path, wanted)
    return dict(wanted)


def digest_of(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
