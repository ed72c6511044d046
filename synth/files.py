"""Whole files or none: written to a temporary name in the same folder, flushed, then renamed."""

import io
import json
import os
from pathlib import Path
from typing import Any

import numpy as np

TEMPORARY_SUFFIX = ".part"


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file that is never seen half-written, even after a crash. Raises OSError with its name."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(path.name + TEMPORARY_SUFFIX)
    try:
        with temporary.open("wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(temporary, path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise OSError(error.errno, error.strerror, str(path)) from error
    except BaseException:  # Ctrl-C too
        temporary.unlink(missing_ok=True)
        raise


def write_text(path: Path, content: str) -> None:
    write_bytes(path, content.encode())


def write_json(path: Path, content: Any) -> None:
    """JSON without NaN or infinity, which JSON does not have."""
    write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def npz(**arrays: np.ndarray) -> bytes:
    """Compressed arrays as a file's content; the same arrays give the same bytes."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def write_npz(path: Path, **arrays: np.ndarray) -> None:
    """Write compressed arrays."""
    write_bytes(path, npz(**arrays))
