"""Running COLMAP's stages so that they can be watched and stopped, and say nothing of their own."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, TypeVar

import pycolmap

T = TypeVar("T")
WATCHED_EVERY_S = 0.2


def quiet() -> None:
    """COLMAP's log is for its developers; what people need to know stands in the results."""
    pycolmap.logging.minloglevel = int(pycolmap.logging.FATAL.value)


def run_watched(stage: Callable[[Any], T], watch: Callable[[], None]) -> T:
    """Run `stage(cancellation_token)` in a thread, calling `watch` now and then; Ctrl-C stops the stage cleanly.

    Raises:
        KeyboardInterrupt: after the stage has stopped; what it had stored is whole.
    """
    quiet()
    token = pycolmap.CancellationToken()
    result: list[T] = []
    failure: list[BaseException] = []

    def run() -> None:
        try:
            result.append(stage(token))
        except BaseException as error:
            failure.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        while thread.is_alive():
            thread.join(WATCHED_EVERY_S)
            watch()
    except KeyboardInterrupt:
        token.cancel()
        thread.join()
        raise
    if failure:
        raise failure[0]
    return result[0]


def count(database: str, table: str, where: str = "") -> int:
    """Rows of a table of COLMAP's database, read beside COLMAP; 0 while there is none."""
    import sqlite3
    from contextlib import closing

    try:
        with closing(sqlite3.connect(f"file:{database}?mode=ro", uri=True, timeout=0.1)) as connection:
            return int(connection.execute(f"SELECT COUNT(*) FROM {table} {where}").fetchone()[0])
    except sqlite3.Error:
        return 0
