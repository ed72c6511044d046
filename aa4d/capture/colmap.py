"""Running COLMAP's stages so that they can be watched and stopped, and say nothing of their own."""

from __future__ import annotations

import errno
import shutil
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import pycolmap

from aa4d.capture.colmap_files import damaged
from aa4d.interrupts import stop_requests

T = TypeVar("T")
U = TypeVar("U")
WATCHED_EVERY_S = 0.2
TO_BEGIN_BYTES, TO_GO_ON_BYTES = 32 << 20, 4 << 20  # free on the disk
PATIENCE_S = 30.0  # with a stage that cannot write: it may never end
MODEL_FILES = ("cameras", "images", "points3D")


def quiet() -> None:
    """COLMAP's log is for its developers; what people need to know stands in the results."""
    pycolmap.logging.minloglevel = int(pycolmap.logging.FATAL.value)


def run(stage: Callable[[Any], T], writes_to: Path, watch: Callable[[], None] = lambda: None) -> T:
    """Run `stage(cancellation_token)` in a thread, calling `watch` now and then; Ctrl-C stops the stage cleanly.

    So does a disk that fills: COLMAP takes a failed write for success, or waits for ever for its database.

    COLMAP's database must not be looked into meanwhile: a second SQLite library in one process, Python's, takes away
    the locks of COLMAP's.

    Args:
        writes_to: the folder that the stage writes to.

    Raises:
        KeyboardInterrupt: after the stage has stopped; what it had stored is whole.
        OSError: there is no space left.
    """
    quiet()
    check_space(writes_to, TO_BEGIN_BYTES)
    token = pycolmap.CancellationToken()
    result: list[T] = []
    failure: list[BaseException] = []

    def work() -> None:
        try:
            result.append(stage(token))
        except BaseException as error:
            failure.append(error)

    thread = threading.Thread(target=work, daemon=True)
    # A flag and no exception: one in the middle of start() would leave the stage running, and COLMAP's own threads
    # abort a process that ends before them.
    with stop_requests() as stop_requested:
        thread.start()
        while thread.is_alive():
            thread.join(WATCHED_EVERY_S)
            watch()
            is_full = shutil.disk_usage(writes_to).free < TO_GO_ON_BYTES
            if stop_requested() or is_full:
                token.cancel()
                thread.join(None if stop_requested() else PATIENCE_S)
            if is_full:
                break
        if stop_requested():
            raise KeyboardInterrupt
    check_space(writes_to, TO_GO_ON_BYTES)
    if failure:
        raise failure[0]
    return result[0]


@contextmanager
def opened(database: Path) -> Iterator[Any]:
    """COLMAP's database, to look into.

    Raises:
        OSError: there is no space left for the files that it makes beside itself.
    """
    try:
        found = pycolmap.Database.open(database)
    except RuntimeError:
        check_space(database.parent, TO_GO_ON_BYTES)
        raise
    with found:
        yield found


def check_space(folder: Path, least: int) -> None:
    """Raises OSError where fewer bytes than `least` are free."""
    if shutil.disk_usage(folder).free < least:
        raise OSError(errno.ENOSPC, f"less than {least >> 20} MiB are free")


def write_model(model: Any, folder: Path) -> None:
    """Write a reconstruction, and look at its files: COLMAP does not say when it could not write them.

    Raises:
        OSError: what stands there is not what was written.
    """
    folder.mkdir(exist_ok=True)
    model.write(folder)
    if not is_whole_model(folder):
        raise OSError(errno.ENOSPC, "COLMAP could not write its model")


def is_whole_model(folder: Path) -> bool:
    """False where a file of a stored reconstruction is missing or cut short, as a full disk leaves it."""
    return all((folder / f"{name}.bin").is_file() for name in MODEL_FILES) and damaged(folder) is None


def in_blocks(items: list[U], size: int) -> Iterator[tuple[int, list[U]]]:
    """Runs of `size` items, each with the number of items before it."""
    for start in range(0, len(items), size):
        yield start, items[start : start + size]
