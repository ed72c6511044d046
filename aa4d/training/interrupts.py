"""Ctrl-C between two iterations."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

StopRequest = Callable[[], bool]


@contextmanager
def stop_requests() -> Iterator[StopRequest]:
    """Ctrl-C asks the loop to stop between two iterations, so that what it saves is whole; a second one insists."""
    requested = False

    def request(_number: int, _frame: FrameType | None) -> None:
        nonlocal requested
        if requested:
            raise KeyboardInterrupt
        requested = True

    try:
        before = signal.signal(signal.SIGINT, request)
    except ValueError:  # not in the main thread: there Ctrl-C belongs to somebody else
        yield lambda: False
        return
    try:
        yield lambda: requested
    finally:
        signal.signal(signal.SIGINT, before)
