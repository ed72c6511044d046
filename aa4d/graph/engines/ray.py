"""Tasks on the machines of a Ray cluster, all of which see the folder of the results under the same path.

Ray decides where a task runs, by its resources. What happens to it comes back as the value that it returns and, while
it runs, as lines of a file in that folder. A machine that is lost gives its tasks to the others, which go on with what
it has left there.
"""

from __future__ import annotations

import importlib.util
import json
import logging
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from aa4d.errors import InputError
from aa4d.graph.engines import Means
from aa4d.graph.events import Advanced, Event, Failed, Finished, Said, Stopped, Tell
from aa4d.graph.task import Resources, Task
from aa4d.graph.work import OUT_OF_MEMORY, Job, attempt

EVENTS = ".events"
AUTO = "auto"
REACHED_WITHIN_S = 5.0
ANSWERED_WITHIN_S = 60.0
LOOK_EVERY_S = 1.0
SAVED_WITHIN_S = 120.0
# After a worker's death, until its machine would be known for lost: a few of Ray's own looks at it.
LOST_WITHIN_S = 40.0
TRIES = 4  # of a task whose machines are lost
GIB = 1 << 30


@dataclass
class Running:
    job: Job
    tell: Tell
    log: Path
    tries: int
    read: int = 0  # bytes of the log
    node: str | None = None  # where it runs
    died: float | None = None  # when its worker did, as far as is known without its machine


class OnRay:
    def __init__(self, ray: Any, jobs: int | None) -> None:
        self._ray = ray
        self.slots = jobs or max(int(ray.cluster_resources().get("CPU", 1)), 1)
        self._remote = ray.remote(max_calls=1)(_work)  # a process for each task, as on one machine
        self._running: dict[Any, Running] = {}
        self._in_doubt: list[Running] = []

    def has_room(self, task: Task) -> bool:  # noqa: ARG002
        return len(self._running) + len(self._in_doubt) < self.slots

    def start(self, job: Job, tell: Tell) -> None:
        if lacking := self._lacking(job.task.resources):
            tell(Failed(job.task, f"no machine of the cluster has {lacking}; add one, or ask for less"))
            return
        job = replace(job, root=job.root.resolve(), threads=job.task.resources.cores or 1)
        self._submit(Running(job, tell, job.root / EVENTS / job.task.digest, 0))

    def _submit(self, running: Running) -> None:
        task, tries = running.job.task, running.tries + 1
        log = running.log.with_suffix(f".{tries}")
        log.parent.mkdir(parents=True, exist_ok=True)
        log.unlink(missing_ok=True)
        options: dict[str, Any] = {"num_cpus": task.resources.cores or 1, "num_gpus": task.resources.gpus}
        if task.resources.memory_gb:
            options["memory"] = int(task.resources.memory_gb * GIB)
        # Tries are counted here: a task that takes all memory is not to do so on every machine.
        remote = self._remote.options(**options, max_retries=0, name=task.title)
        self._running[remote.remote(running.job, str(log))] = Running(running.job, running.tell, log, tries)

    def _lacking(self, wanted: Resources) -> str:
        """What no machine has, in words; empty where one has it all."""
        amounts = {
            "CPU": (wanted.cores or 1, f"{wanted.cores or 1} cores"),
            "GPU": (wanted.gpus, f"{wanted.gpus:g} GPUs"),
            "memory": (wanted.memory_gb * GIB, f"{wanted.memory_gb:g} GB of memory"),
        }
        for node in self._nodes():
            if all(node["Resources"].get(name, 0) >= amount for name, (amount, _) in amounts.items()):
                return ""
        return " and ".join(words for amount, words in amounts.values() if amount)

    def _nodes(self) -> list[dict[str, Any]]:
        return [node for node in self._ray.nodes() if node["Alive"]]

    def wait(self) -> None:
        ready, _ = self._ray.wait(list(self._running), timeout=LOOK_EVERY_S) if self._running else ([], [])
        if not self._running:
            time.sleep(LOOK_EVERY_S)
        for running in list(self._running.values()):
            self._hear(running)
        for reference in ready:
            running = self._running.pop(reference)
            event = self._ending(reference, running)
            if event is None:
                self._in_doubt.append(replace(running, died=time.monotonic()))
            elif isinstance(event, Stopped):
                running.tell(Failed(event.task, "was stopped from outside; the same command continues it"))
            else:
                running.tell(event)
        self._settle_doubts()

    def _ending(self, reference: Any, running: Running) -> Event | None:
        """How a task has ended; None where its worker died and why is to be found out."""
        errors, task = self._ray.exceptions, running.job.task
        self._hear(running)
        running.log.unlink(missing_ok=True)
        try:
            event: Event = self._ray.get(reference, timeout=SAVED_WITHIN_S)
        except errors.OutOfMemoryError:
            return Failed(task, OUT_OF_MEMORY)
        except errors.TaskCancelledError:
            return Stopped(task)
        except (errors.WorkerCrashedError, errors.NodeDiedError, errors.LocalRayletDiedError):
            return None
        except errors.RayError as error:
            return Failed(task, f"Ray: {str(error).strip().splitlines()[-1]}")
        return event

    def _settle_doubts(self) -> None:
        """A worker died: with its machine, and its task is tried on another one; or alone, as where memory runs out."""
        if not self._in_doubt:
            return
        alive = {node["NodeID"] for node in self._nodes()}
        for running in list(self._in_doubt):
            assert running.died is not None
            task, is_lost = running.job.task, running.node not in alive
            if not is_lost and time.monotonic() - running.died < LOST_WITHIN_S:
                continue
            self._in_doubt.remove(running)
            if not is_lost:
                running.tell(Failed(task, OUT_OF_MEMORY))
            elif running.tries == TRIES:
                running.tell(Failed(task, f"its machine was lost, {TRIES} times; see to the cluster"))
            else:
                running.tell(Said(task, "its machine was lost; another one goes on with it"))
                self._submit(running)

    def _hear(self, running: Running) -> None:
        """Pass on what a task has said since the last look."""
        task = running.job.task
        for line in _lines(running):
            if "node" in line:
                running.node = line["node"]
            elif "said" in line:
                running.tell(Said(task, line["said"]))
            else:
                running.tell(Advanced(task, line["done"], line["total"], line["facts"]))

    def stop(self) -> None:
        """Ask all tasks to save. One that does not answer in time ends with `close`; what is whole is on disk.

        None is cancelled by force: Ray aborts the process that does so while the task's answer is under way.
        """
        for reference in self._running:
            self._ray.cancel(reference, force=False)
        references = list(self._running)
        ready, _ = self._ray.wait(references, num_returns=len(references), timeout=SAVED_WITHIN_S)
        for reference, running in self._running.items():
            event = self._ending(reference, running) if reference in ready else None
            running.tell(event or Stopped(running.job.task))
        self._running.clear()

    def close(self) -> None:
        self._ray.shutdown()


def _lines(running: Running) -> Iterator[dict[str, Any]]:
    """The whole lines that have come since the last look."""
    try:
        with running.log.open("rb") as file:
            file.seek(running.read)
            new = file.read()
    except OSError:
        return
    whole = new[: new.rfind(b"\n") + 1]
    running.read += len(whole)
    for line in whole.splitlines():
        yield json.loads(line)


def _work(job: Job, log: str) -> Event:
    """A job in a worker of the cluster; returns how it ended."""
    import ray

    endings: list[Event] = []
    last = -LOOK_EVERY_S
    with Path(log).open("a", encoding="utf-8", buffering=1) as file:

        def write(line: dict[str, Any]) -> None:
            file.write(json.dumps(line) + "\n")

        def tell(event: Event) -> None:
            nonlocal last
            if isinstance(event, Finished | Failed | Stopped):
                endings.append(event)
            elif isinstance(event, Said):
                write({"said": event.text})
            elif isinstance(event, Advanced) and time.monotonic() - last >= LOOK_EVERY_S:
                last = time.monotonic()
                write({"done": event.done, "total": event.total, "facts": event.facts})

        write({"node": ray.get_runtime_context().get_node_id()})
        signal.signal(signal.SIGINT, signal.default_int_handler)  # what Ray's cancelling calls
        attempt(job, tell)
    return endings[0]


def engine(means: Means) -> OnRay:
    """
    Raises:
        InputError: Ray is not installed, no address is given, or nobody answers there in time.
    """
    if importlib.util.find_spec("ray") is None:
        raise InputError('--engine ray: Ray is not installed; pip install "aa4d[cluster]", on every machine')
    if means.address is None:
        raise InputError(
            "--engine ray: say which cluster with --address HOST:PORT, or auto for the one of this machine"
        )
    _check(means.address)
    import ray

    try:
        ray.init(address=means.address, log_to_driver=False, logging_level=logging.ERROR)
    except (ConnectionError, RuntimeError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"--address {means.address}: cannot join that Ray cluster ({reason})") from None
    return OnRay(ray, means.jobs)


def _check(address: str) -> None:
    """Raises InputError, after a bounded wait, where no cluster answers."""
    help_ = "start one with `ray start --head`, or give the address that it printed"
    if address != AUTO:
        host, colon, port = address.rpartition(":")
        if not colon or not host or not port.isdecimal() or not 0 < int(port) < 65536:
            raise InputError(f"--address {address}: write HOST:PORT, or auto")
        try:
            socket.create_connection((host, int(port)), REACHED_WITHIN_S).close()
        except OSError as error:
            raise InputError(f"--address {address}: nobody answers there ({error}); {help_}") from None
    # In a process of its own, which can be left to itself: Ray waits for long in ways that cannot be interrupted.
    code = "import ray, sys; ray.init(address=sys.argv[1], log_to_driver=False); ray.shutdown()"
    try:
        answered = subprocess.run(
            [sys.executable, "-c", code, address], capture_output=True, timeout=ANSWERED_WITHIN_S, check=False
        )
    except subprocess.TimeoutExpired:
        raise InputError(
            f"--address {address}: no Ray cluster answers there within {ANSWERED_WITHIN_S:.0f} s; {help_}"
        ) from None
    if answered.returncode != 0:
        raise InputError(f"--address {address}: what answers there is no Ray cluster of this version; {help_}")
