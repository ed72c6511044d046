"""A capture's identity: of its index and of every file beside it (docs/formats.md)."""

from __future__ import annotations

from pathlib import Path, PurePosixPath
from typing import Any

from aa4d.errors import InputError
from aa4d.files import read_json_object
from aa4d.identity import Identity, digest_of, digest_of_file, identity_of

CHECKSUMS = "checksums.json"
# What a capture without checksums is hashed by; whatever else lies in its folder is not the capture's.
PARTS = (
    *("frames", "truth", "movers", "left_out", "points.ply", "transforms.json", "sparse"),
    *("poses.tum", "mot", "coco.json", "uncompressed", "video.mp4"),
)
READ_HERE = ("frames", "truth", "movers", "left_out", "points.ply")  # the other files may be left out of a copy


def capture_identity(folder: Path, index: dict[str, Any]) -> Identity:
    """The identity of the capture in `folder`, whose capture.json is `index`.

    The files' digests are those of checksums.json. Without that file they are computed, which takes a second for
    1 GB: captures of older versions of `aa4d capture` have none.

    Raises:
        InputError: checksums.json is damaged, or the index holds a number that is not finite where nobody reads it.
    """
    files = listed(folder)
    if files is None:
        files = digests_of(folder)
    written = identity_of(index.get("identity"))
    try:
        content = content_of(index, files)
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"{folder / 'capture.json'}: holds what is no JSON ({error}); make the capture again"
        ) from None
    return Identity("capture", content, {} if written is None else written.made_from)


def content_of(index: dict[str, Any], files: dict[str, str]) -> str:
    """The digest of a capture's content. Who made it with what is said by `made_from`."""
    held = {key: value for key, value in index.items() if key not in ("identity", "generator")}
    return digest_of({"index": held, "files": files})


def listed(folder: Path) -> dict[str, str] | None:
    """SHA-256 by path as checksums.json has it; None where there is no such file."""
    path = folder / CHECKSUMS
    if not path.is_file():
        return None
    files = read_json_object(path, "the checksums of a capture")
    for name, value in files.items():
        pure = PurePosixPath(name)
        if not isinstance(value, str) or pure.is_absolute() or ".." in pure.parts or "\\" in name:
            raise InputError(f"{path}: {name!r} is no checksum of a file in the capture; make the capture again")
    return files


def digests_of(folder: Path) -> dict[str, str]:
    """SHA-256 by path of all files of the capture in `folder`, but for capture.json and checksums.json."""
    paths = [p for part in PARTS for p in (folder / part, *sorted((folder / part).rglob("*"))) if p.is_file()]
    return {p.relative_to(folder).as_posix(): digest_of_file(p) for p in paths}


def check_content(folder: Path) -> None:
    """Raises InputError where a file is not as checksums.json has it, so that nobody learns from a damaged capture."""
    files = listed(folder)
    if files is None:
        return
    paths = [p for part in READ_HERE for p in (folder / part, *(folder / part).rglob("*")) if p.is_file()]
    for path in paths:
        name = path.relative_to(folder).as_posix()
        if name not in files and not path.name.startswith("."):
            raise InputError(
                f"{folder / CHECKSUMS}: does not list {name}; make the capture again, or delete this file to use the "
                "capture as it is now, as another one"
            )
    for name, expected in files.items():
        path = folder / name
        is_needed = PurePosixPath(name).parts[0] in READ_HERE
        if (is_needed or path.exists()) and (not path.is_file() or digest_of_file(path) != expected):
            if not path.is_file():
                raise InputError(f"{path}: is missing; make the capture again, or copy the file to its place")
            raise InputError(
                f"{path}: was changed since the capture was made; make the capture again, or delete "
                f"{folder / CHECKSUMS} to use it as it is now, as another capture"
            )
