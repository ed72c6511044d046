"""A process that must not outlive the one that started it."""

from __future__ import annotations

import multiprocessing
import os
import threading
import time

LOOKED_EVERY_S = 0.5


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
