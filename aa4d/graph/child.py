"""A program that a task runs."""

from __future__ import annotations

import re
import signal
from collections.abc import Callable

from aa4d.errors import InputError, Interrupted
from aa4d.graph.call import Call

FRAME = re.compile(r"frame (\d+)/(\d+)")
INTERRUPTED = (130, -signal.SIGINT, -signal.SIGTERM)  # of one that saved, and of one that did not know how


def run_child(call: Call, run: Callable[[Callable[[str], None]], int], what: str) -> None:
    """Tell how far it is by the frames that it counts.

    Args:
        run: runs the program, hands over each line that it prints, and returns its exit code.
        what: it is doing, for the sentence where it says nothing.

    Raises:
        InputError: the last line that it printed, where it fails.
        Interrupted: it was asked to stop, and has saved what it had.
    """
    last = ""

    def hear(line: str) -> None:
        nonlocal last
        if (frame := FRAME.match(line)) is not None:
            call.advance(int(frame[1]), int(frame[2]))
        last = line or last

    code = run(hear)
    if code in INTERRUPTED:
        raise Interrupted(last)
    if code != 0:
        raise InputError(last or f"{what} ended with exit code {code}")
