"""Ctrl-C around what must not be cut in two."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def interrupt_deferred() -> Iterator[None]:
    """Ctrl-C inside takes effect at the end.

    Cycles calls Python in the middle of a render and swallows what is raised there: the interrupt would be lost, and
    the picture would be half a picture. Blender that is interrupted while it loads crashes.
    """
    pending = False

    def remember(*_: object) -> None:
        nonlocal pending
        pending = True

    before = signal.signal(signal.SIGINT, remember)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if pending:
        raise KeyboardInterrupt
