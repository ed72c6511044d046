"""A process that lives by the one that started it: Ctrl-C reaches it through that one, and it does not outlive it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from multiprocessing import resource_tracker
from multiprocessing.process import BaseProcess

LOOKED_EVERY_S = 0.5


def start_without_interrupts(process: BaseProcess) -> None:
    """Start a process that inherits a block of Ctrl-C, which it lifts itself if it can answer it."""
    resource_tracker.ensure_running()  # else the first start begins it, which lifts the block
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        process.start()
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def end_with_parent() -> None:
    """From here on this process of multiprocessing ends at once where its parent is gone, whatever it is doing.

    Its files are to be whole at every moment, as after `kill -9`; the same command then finds its folder free.
    """
    starter = multiprocessing.parent_process()  # it may be gone already: then somebody else is the parent
    threading.Thread(target=_end_with, args=(starter and starter.pid,), daemon=True).start()


def _end_with(parent: int | None) -> None:
    while os.getppid() == parent:
        time.sleep(LOOKED_EVERY_S)
    os._exit(1)
