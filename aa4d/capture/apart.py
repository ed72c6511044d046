"""COLMAP's stages that write to its database, in a process of their own.

Where a write fails, SQLite's error ends the whole process, from a thread of COLMAP's that nobody can catch it in. What
is lost then is a block of frames or pairs; the database is as SQLite left it, whole.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from aa4d.capture.colmap import TO_BEGIN_BYTES, TO_GO_ON_BYTES, WATCHED_EVERY_S, check_space, quiet
from aa4d.errors import InputError
from aa4d.interrupts import stop_requests
from aa4d.parent import end_with_parent, start_without_interrupts

Run = Callable[..., None]


@contextmanager
def apart(writes_to: Path) -> Iterator[Run]:
    """A function that calls `stage(*arguments, **options)` over there, all of which can be pickled, and waits.

    It raises KeyboardInterrupt for Ctrl-C; OSError where the disk of the folder `writes_to` fills; InputError where
    COLMAP ends the process for another reason; what the stage raises.
    """
    context = multiprocessing.get_context("spawn")  # not forked: COLMAP's threads do not survive that
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(theirs,), daemon=True)
    start_without_interrupts(process)  # Ctrl-C in the terminal is for this process, which then ends it
    theirs.close()

    def run(stage: Callable[..., object], *arguments: Any, **options: Any) -> None:
        check_space(writes_to, TO_BEGIN_BYTES)
        with suppress(BrokenPipeError):  # it has ended: `_answer` says so
            ours.send((stage, arguments, options))
        failure = _answer(ours, writes_to)
        check_space(writes_to, TO_GO_ON_BYTES)
        if failure is not None:
            raise failure

    try:
        yield run
    finally:
        process.kill()
        process.join()
        ours.close()


def _answer(ours: Connection, writes_to: Path) -> BaseException | None:
    with stop_requests() as stop_requested:
        while not ours.poll(WATCHED_EVERY_S):
            if stop_requested():
                raise KeyboardInterrupt
            check_space(writes_to, TO_GO_ON_BYTES)  # it may wait for ever for a database that it cannot write
    try:
        failure: BaseException | None = ours.recv()
    except EOFError:
        free = shutil.disk_usage(writes_to).free >> 20
        return InputError(
            f"{writes_to}: COLMAP died, with {free} MiB free on the disk; the same command goes on from what is stored"
        )
    return failure


def _serve(theirs: Connection) -> None:
    end_with_parent()
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # COLMAP's last words are for its developers
    quiet()
    while True:
        try:
            stage, arguments, options = theirs.recv()
        except EOFError:
            return
        try:
            stage(*arguments, **options)
            theirs.send(None)
        except Exception as error:
            theirs.send(error)
