"""Ctrl-C, or a batch system's request to stop, at a moment that suits."""

from __future__ import annotations

import os
import signal
import threading
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


@contextmanager
def interrupted_at_once() -> Iterator[None]:
    """For long work without a moment that suits: a signal raises KeyboardInterrupt where it arrives, inside
    `stop_requests` too."""

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    try:
        before = {number: signal.signal(number, interrupt) for number in SIGNALS}
    except ValueError:  # not in the main thread: there signals belong to somebody else
        yield
        return
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def end_quietly_while_importing() -> None:
    """From here on, Ctrl-C while a module is imported ends the process at once, with exit code 130.

    An exception there is no use: libraries take it for a fault of theirs ("cannot import the C++ backend") or leave
    half a module behind. Files that were begun are as after `kill -9`, which every command survives. At any other
    moment it is KeyboardInterrupt.
    """
    if threading.current_thread() is threading.main_thread():  # elsewhere signals belong to somebody else
        signal.signal(signal.SIGINT, _interrupt)


def _interrupt(number: int, frame: FrameType | None) -> None:
    outer = frame
    while outer is not None:
        if outer.f_code.co_filename.startswith("<frozen importlib"):
            os.write(2, b"aa4d: stopped\n")
            os._exit(128 + number)
        outer = outer.f_back
    signal.default_int_handler(number, frame)
