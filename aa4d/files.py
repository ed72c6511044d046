"""Files that are whole or absent: written beside their name, flushed, renamed."""

from __future__ import annotations

import errno
import json
import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from aa4d.errors import InputError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

UNFINISHED = ".part"
TEMPORARY = re.compile(rf"\.(?P<name>.+)\.[a-z0-9_]{{8}}{re.escape(UNFINISHED)}(?P<suffix>(\.[^.]+)?)")
LOCK = ".lock"
ROOM_BYTES = 1 << 16
_cleaned: set[Path] = set()  # folders in which this process has looked for what killed ones left
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path in the same folder; on success it replaces `path`, on any error nothing is left.

    Raises:
        OSError: it cannot be written, with its name. Where the disk is full, also instead of what a library says then.
    """
    with _named(path):
        if path.parent not in _cleaned:
            remove_unfinished(path.parent)
            _cleaned.add(path.parent)
        handle, temporary = _begun(path)
        try:
            try:
                yield temporary
            except OSError:
                raise
            except Exception as error:
                _check_room(temporary, str(error))
                raise
            with temporary.open("rb") as file:
                os.fsync(file.fileno())
            # mkstemp makes files that only the owner reads; results are ordinary files.
            umask = os.umask(0)
            os.umask(umask)
            temporary.chmod(0o666 & ~umask)
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)
            if handle is not None:
                os.close(handle)


def _begun(path: Path) -> tuple[int | None, Path]:
    """A new temporary file for `path`, and the handle that holds its lock until it is closed; None on Windows."""
    while True:
        # The ending is kept: some libraries choose the format by it.
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=f"{UNFINISHED}{path.suffix}")
        if fcntl is None:
            os.close(handle)
            return None, Path(name)
        _lock(handle)
        if os.fstat(handle).st_nlink:
            return handle, Path(name)
        os.close(handle)  # another process took it for a killed one's in the moment before it was locked


def _lock(handle: int) -> bool:
    """Whether it is this process's now."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:  # or the file system has no locks: nothing is taken for a killed process's there
        return False
    return True


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Let an OSError name `path` where it names nothing, or the temporary file in its place."""
    try:
        yield
    except OSError as error:
        is_temporary = error.filename is not None and Path(str(error.filename)).name.startswith(f".{path.name}.")
        if error.errno is None or not (error.filename is None or is_temporary):
            raise
        raise OSError(error.errno, error.strerror or os.strerror(error.errno), str(path)) from error


def _check_room(unfinished: Path, said: str) -> None:
    """Raises OSError where nothing more can be written to the file, of which libraries make errors of their own.

    The sentence that they say may quote the system; and some have deleted what they wrote, so that there is room again.
    """
    for number in FULL:
        if os.strerror(number) in said:
            raise OSError(number, os.strerror(number))
    with unfinished.open("ab") as file:
        file.write(bytes(ROOM_BYTES))
        file.flush()
        os.fsync(file.fileno())


def remove_unfinished(folder: Path) -> None:
    """Delete what killed processes left in `folder` of files that they had not finished; those being written stay."""
    if fcntl is None:
        return
    for left in folder.glob(f".*{UNFINISHED}*"):
        named = TEMPORARY.fullmatch(left.name)
        if named is None or Path(named["name"]).suffix != named["suffix"]:
            continue  # somebody else's
        try:
            handle = os.open(left, os.O_RDONLY)
        except OSError:
            continue
        try:
            if _lock(handle):
                left.unlink(missing_ok=True)
        except OSError:  # it may not be deleted, nor may the folder be written then
            continue
        finally:
            os.close(handle)


def write_bytes(path: Path, content: bytes) -> None:
    """Write what was made in memory, as numpy's archives are: they complain of a full disk again when freed."""
    with whole_file(path) as temporary:
        temporary.write_bytes(content)


def write_text(path: Path, text: str) -> None:
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, value: Any) -> None:
    # allow_nan=False: NaN is not JSON, and other readers refuse it.
    write_text(path, json.dumps(value, indent=2, allow_nan=False) + "\n")


def read_json_object(path: Path, what: str) -> dict[str, Any]:
    """Raises InputError where the file is absent, is not JSON or holds something other than an object."""
    try:
        value = json.loads(path.read_text(encoding="utf-8-sig"))  # some editors begin with a byte order mark
    except FileNotFoundError:
        raise InputError(f"{path}: not found; expected {what}") from None
    except (OSError, ValueError, RecursionError) as error:  # no text, no JSON, numbers or nesting without end
        raise InputError(f"{path}: not readable as {what} ({error})") from None
    if not isinstance(value, dict):
        raise InputError(f"{path}: expected {what}, found a JSON {type(value).__name__}")
    return value


def make_folder(path: Path) -> None:
    """Raises InputError where `path` cannot be a writable folder."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except OSError as error:
        raise InputError(f"{path}: cannot write there ({error.strerror}); choose another folder with --out") from None


@contextmanager
def claimed(folder: Path, doing: str) -> Iterator[None]:
    """Make the folder this process's own, and rid it of what a killed one left half-written.

    Args:
        doing: what the process does there, for the one that comes second.

    Raises:
        InputError: the folder is not writable, or another process has claimed it.
    """
    make_folder(folder)
    lock = FileLock(folder / LOCK)  # the system releases it when the process dies
    try:
        lock.acquire(timeout=0)
    except Timeout:
        raise InputError(f"{folder}: another process is {doing} there; wait for it, or choose a new --out") from None
    try:
        remove_unfinished(folder)
        yield
    finally:
        lock.release()
