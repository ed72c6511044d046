"""Ctrl-C, or a batch system's request to stop, at a moment that suits."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

StopRequest = Callable[[], bool]
SIGNALS = (signal.SIGINT, signal.SIGTERM)  # Ctrl-C, and what batch systems send before they kill


@contextmanager
def stop_requests() -> Iterator[StopRequest]:
    """A signal asks a loop to stop when it next looks, so that what it saves is whole; a second one insists."""
    requested = False

    def request(_number: int, _frame: FrameType | None) -> None:
        nonlocal requested
        if requested:
            raise KeyboardInterrupt
        requested = True

    try:
        before = {number: signal.signal(number, request) for number in SIGNALS}
    except ValueError:  # not in the main thread: there signals belong to somebody else
        yield lambda: False
        return
    try:
        yield lambda: requested
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
