"""Scene files as `aa4d` sees them: what they are made of. Only synth/ understands them."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from aa4d.errors import InputError
from aa4d.identity import digest_of, digest_of_file


def scene_digest(scene: Path) -> str:
    """Of the bytes of a scene file, and of those of the files that it names.

    Raises:
        InputError: it is not there.
    """
    if not scene.is_file():
        raise InputError(f"{scene}: no such scene file; scenes/ holds some")
    return digest_of([digest_of_file(path) for path in (scene, *files_named_in(scene))])


def files_named_in(scene: Path) -> tuple[Path, ...]:
    """Tables of tracks and models that a scene file names. One that cannot be read names none: synth will refuse it."""

    def texts(value: Any) -> Iterator[str]:
        if isinstance(value, str):
            yield value
        for inner in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
            yield from texts(inner)

    try:
        table = tomllib.loads(scene.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError):
        return ()
    return tuple(sorted(path for text in texts(table) if text and (path := scene.parent / text).is_file()))
