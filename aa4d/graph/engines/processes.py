"""Some tasks at a time, each in a process of its own on this machine."""

from __future__ import annotations

import multiprocessing
import os
import signal
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess

from aa4d.graph.engines import Means
from aa4d.graph.events import Event, Failed, Finished, Stopped, Tell
from aa4d.graph.task import Task
from aa4d.graph.work import OUT_OF_MEMORY, Job, attempt
from aa4d.parent import end_with_parent, start_without_interrupts

LONGEST_WAIT_S = 1.0


class Processes:
    def __init__(self, jobs: int) -> None:
        self.slots = jobs
        # Not forked: torch's threads do not survive that.
        self._context = multiprocessing.get_context("spawn")
        self._running: dict[Connection, tuple[Job, Tell, BaseProcess]] = {}

    def has_room(self, task: Task) -> bool:  # noqa: ARG002
        return len(self._running) < self.slots

    def start(self, job: Job, tell: Tell) -> None:
        ours, theirs = self._context.Pipe(duplex=False)
        process = self._context.Process(target=_work, args=(job, theirs))
        start_without_interrupts(process)  # `_work` lifts the block once it can answer
        theirs.close()
        self._running[ours] = (job, tell, process)

    def wait(self) -> None:
        for connection in wait(list(self._running), LONGEST_WAIT_S):
            assert isinstance(connection, Connection)
            event = self._next(connection)
            if isinstance(event, Stopped):  # a signal that somebody else sent to this process alone
                event = Failed(event.task, "was stopped from outside; the same command continues it")
            self._told(connection, event)

    def _next(self, connection: Connection) -> Event:
        """What a process says next; one that says nothing any more has died."""
        job, _, process = self._running[connection]
        try:
            event: Event = connection.recv()
        except EOFError:
            process.join()
            code = process.exitcode
            return Failed(
                job.task, OUT_OF_MEMORY if code == -signal.SIGKILL else f"its process died (exit code {code})"
            )
        return event

    def _told(self, connection: Connection, event: Event) -> None:
        """Pass an event on. A process that has said its last is gone first."""
        _, tell, process = self._running[connection]
        if isinstance(event, Finished | Failed | Stopped):
            process.join()
            connection.close()
            del self._running[connection]
        tell(event)

    def stop(self) -> None:
        for _, _, process in self._running.values():
            if process.pid is not None:
                os.kill(process.pid, signal.SIGINT)
        for connection in list(self._running):
            while connection in self._running:
                self._told(connection, self._next(connection))

    def close(self) -> None:
        """After an error of ours: what is whole is on disk."""
        for _, _, process in self._running.values():
            process.kill()
            process.join()
        self._running.clear()


def engine(means: Means) -> Processes:
    return Processes(means.jobs or 1)


def _work(job: Job, parent: Connection) -> None:
    """A job in a process of its own.

    It leaves the terminal's process group, so that Ctrl-C reaches it once, from the parent; and it ends where the
    parent is gone, so that the same command finds the task's folder free.
    """
    os.setpgrp()
    end_with_parent()
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    with suppress(BrokenPipeError, KeyboardInterrupt):
        attempt(job, parent.send)
