"""Running COLMAP's stages so that they can be watched and stopped, and say nothing of their own."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import pycolmap

from aa4d.interrupts import stop_requests

T = TypeVar("T")
U = TypeVar("U")
WATCHED_EVERY_S = 0.2


def quiet() -> None:
    """COLMAP's log is for its developers; what people need to know stands in the results."""
    pycolmap.logging.minloglevel = int(pycolmap.logging.FATAL.value)


def run(stage: Callable[[Any], T], watch: Callable[[], None] = lambda: None) -> T:
    """Run `stage(cancellation_token)` in a thread, calling `watch` now and then; Ctrl-C stops the stage cleanly.

    COLMAP's database must not be looked into meanwhile: a second SQLite library in one process, Python's, takes away
    the locks of COLMAP's.

    Raises:
        KeyboardInterrupt: after the stage has stopped; what it had stored is whole.
    """
    quiet()
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
            if stop_requested():
                token.cancel()
                thread.join()
        if stop_requested():
            raise KeyboardInterrupt
    if failure:
        raise failure[0]
    return result[0]


def in_blocks(items: list[U], size: int) -> Iterator[tuple[int, list[U]]]:
    """Runs of `size` items, each with the number of items before it."""
    for start in range(0, len(items), size):
        yield start, items[start : start + size]
