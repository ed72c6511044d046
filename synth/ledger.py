"""What a capture's files held when they were written, so that none is trusted by its name.

While a capture is unfinished, every file of a frame is noted in `unfinished.sha256` (the format of `sha256sum`); the
finished one has `checksums.json`. A file that a power cut emptied or shortened, or that somebody exchanged, is found by
its digest, and one without a digest by reading it.
"""

import hashlib
import json
import os
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

import numpy as np

from synth.develop import read_png
from synth.files import write_bytes

INDEX = "capture.json"
LEDGER = "unfinished.sha256"
CHECKSUMS = "checksums.json"


def note(root: Path, name: str, content: bytes) -> None:
    """Write a file of the capture `root` whole, and its digest to the ledger. Several processes may do so."""
    write_bytes(root / name, content)
    line = f"{hashlib.sha256(content).hexdigest()}  {name}\n".encode()
    handle = os.open(root / LEDGER, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    try:
        os.write(handle, line)  # one write of a short line: those of others stand before or after it
    finally:
        os.close(handle)


def noted(root: Path) -> dict[str, str]:
    """Digests by relative path: of checksums.json, and later ones of the ledger. A line that was cut short is none."""
    digests: dict[str, str] = {}
    try:
        stored = json.loads((root / CHECKSUMS).read_text(encoding="utf-8"))
        digests |= {str(name): str(digest) for name, digest in stored.items() if _inside(name)}
    except (OSError, ValueError, AttributeError):
        pass
    try:
        lines = (root / LEDGER).read_text(encoding="utf-8", errors="replace").splitlines(keepends=True)
    except OSError:
        return digests
    for line in lines:
        digest, _, name = line.rstrip("\n").partition("  ")
        if line.endswith("\n") and len(digest) == 64 and _inside(name):
            digests[name] = digest
    return digests


def _inside(name: str) -> bool:
    pure = PurePosixPath(name)
    return not pure.is_absolute() and ".." not in pure.parts and "\\" not in name


def mend(root: Path, names: Iterable[str], *, finished: bool) -> list[str]:
    """Remove those of the files `names` that do not hold what they held when they were written, and of a finished
    capture its index when any of its files is such, or missing: the same run then makes them again. Returns them."""
    digests = noted(root)
    wrong = [name for name in names if (root / name).is_file() and not _sound(root / name, digests.get(name))]
    if finished:
        wrong += [name for name in digests if name not in wrong and not _sound(root / name, digests[name])]
        if not _is_json(root / INDEX):
            wrong.append(INDEX)
        if wrong:
            (root / INDEX).unlink(missing_ok=True)
    for name in wrong:
        (root / name).unlink(missing_ok=True)
    return wrong


def told(root: Path, wrong: list[str]) -> str:
    """One line on what `mend` found."""
    more = f" and {len(wrong) - 4} more" if len(wrong) > 4 else ""
    return f"{root}: missing, damaged or exchanged, and made again: {', '.join(wrong[:4])}{more}"


def _is_json(path: Path) -> bool:
    try:
        return isinstance(json.loads(path.read_text(encoding="utf-8")), dict)
    except (OSError, ValueError):
        return False


def _sound(path: Path, digest: str | None) -> bool:
    try:
        content = path.read_bytes()
        if digest is not None:
            return hashlib.sha256(content).hexdigest() == digest
        if path.suffix == ".png":
            read_png(content)
        elif path.suffix == ".npz":
            with np.load(path, allow_pickle=False) as arrays:
                dict(arrays)
        return len(content) > 0
    except Exception:  # zipfile, zlib and numpy each raise their own kind for a damaged file
        return False
