"""One task done, in whatever process: what every engine calls."""

from __future__ import annotations

import time
import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from aa4d.errors import InputError, Interrupted
from aa4d.files import FULL
from aa4d.graph.call import Call, Need, use_threads
from aa4d.graph.events import Failed, Finished, Stopped, Tell
from aa4d.graph.kinds import Kept, kind_of
from aa4d.graph.store import Store
from aa4d.graph.task import Task

OUT_OF_MEMORY = (
    "its process was killed (signal 9), as the system does where memory runs out; run fewer tasks at a time, or ask "
    "for smaller frames, and run the same command again"
)


@dataclass(frozen=True)
class Job:
    """A task whose needs are there."""

    root: Path  # of the store
    task: Task
    needs: Mapping[str, Kept]  # by the digests of their tasks; of a partial task, those that came to something
    failures: Mapping[str, str]  # sentences by the names of the others
    threads: int | None = None  # None: torch chooses

    @property
    def contents(self) -> dict[str, str]:
        return {digest: kept.content for digest, kept in self.needs.items()}


def attempt(job: Job, tell: Tell) -> None:
    """Do it; what ends it is told, exactly one of Finished, Failed and Stopped."""
    task = job.task
    try:
        tell(Finished(task, perform(job, tell)))
    except InputError as error:
        tell(Failed(task, str(error)))
    except (Interrupted, KeyboardInterrupt):
        tell(Stopped(task))
    except MemoryError:
        tell(Failed(task, "ran out of memory; run fewer tasks at a time (--jobs), or ask for smaller frames"))
    except OSError as error:
        full = "; free some, and run the same command again" if error.errno in FULL else ""
        tell(Failed(task, f"{error.filename or job.root}: {error.strerror or error}{full}"))
    except Exception as error:
        traceback.print_exc()
        tell(Failed(task, f"{type(error).__name__}: {error}"))


def perform(job: Job, tell: Tell) -> Kept:
    """Make the result, or find that another process has made it. Raises what the kind's function raises."""
    store, task = Store(job.root), job.task
    with store.making(task) as folder:
        if (kept := store.kept(task, job.contents)) is not None:
            return kept
        use_threads(job.threads)
        needs = tuple(
            Need(need, store.folder(need), job.needs[need.digest].result, job.needs[need.digest].seconds)
            for need in task.needs
            if need.digest in job.needs
        )
        before, started = store.spent(task), time.perf_counter()
        try:
            result = kind_of(task.kind).run(Call(task, folder, needs, job.failures, tell))
        except BaseException:
            store.interrupted(task, before + time.perf_counter() - started)
            raise
        return store.keep(task, job.contents, result, before + time.perf_counter() - started)
