"""A folder that a command fills file by file, and may continue to fill when it is run again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from aa4d.errors import InputError
from aa4d.files import make_folder, read_json_object, write_json
from aa4d.identity import Identity, digest_of, digest_of_file, identity_of

if TYPE_CHECKING:
    from aa4d.methods.model_file import LoadedModel


def claim_folder(out: Path, index_name: str, wanted: dict[str, Any], what: str) -> dict[str, Any]:
    """The index of what `out` holds, written first: a folder is new, empty, or this very output.

    Raises:
        InputError: see `index_in`.
    """
    found = index_in(out, index_name, wanted, what)
    if found is not None:
        return found
    make_folder(out)
    write_json(out / index_name, wanted)
    return dict(wanted)


def index_in(out: Path, index_name: str, wanted: dict[str, Any], what: str) -> dict[str, Any] | None:
    """The index of what `out` holds, None where the folder is new or empty. Writes nothing.

    Args:
        wanted: everything that the files depend on; further keys of an index that is there are its own. Where it has
            an "identity" and so has the index, the two alone are compared.
        what: "a render", for messages.

    Raises:
        InputError: `out` holds something else.
    """
    path = out / index_name
    if path.exists():
        found = read_json_object(path, f"the index of {what}")
        if "identity" in wanted and identity_of(found.get("identity")) is not None:
            keys = ["identity"]
        else:  # of an older version
            keys = [key for key in wanted if key != "identity"]
        if any(found.get(key) != wanted[key] for key in keys):
            raise InputError(f"{out}: holds {what} with other settings; choose another --out, or delete that folder")
        return found
    if out.is_file():
        raise InputError(f"{out}: is a file; choose a new folder with --out")
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out}: not empty and not {what}; choose a new folder with --out")
    return None


def index_of(kind: str, loaded: LoadedModel, settings: dict[str, Any]) -> dict[str, Any]:
    """The index of files that are made from a model: the settings, and the identity that follows from them."""
    identity = Identity(kind, digest_of(settings), {"model": loaded.identity.digest()})
    return {**settings, "model_sha256": digest_of_file(loaded.path), "identity": identity.as_json()}
