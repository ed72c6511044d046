"""How the engine ray takes what Ray tells it, by a stand-in for Ray that tells it at once."""

import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from aa4d.graph.engines import ray as engine_module
from aa4d.graph.engines.ray import OnRay
from aa4d.graph.events import Advanced, Event, Failed, Finished, Said, Stopped
from aa4d.graph.scheduler import Outcome, run_graph
from aa4d.graph.store import Store
from aa4d.graph.task import Resources, Task
from aa4d.graph.work import OUT_OF_MEMORY, Job, attempt
from tests.graph.toy import toy

NAMES = ("WorkerCrashedError", "NodeDiedError", "LocalRayletDiedError", "OutOfMemoryError", "TaskCancelledError")


class StandIn:
    """Machines "a" and "b". A task is done at once, or ends as the next of `endings` says."""

    def __init__(self) -> None:
        error = type("RayError", (Exception,), {})
        self.exceptions = SimpleNamespace(RayError=error, **{name: type(name, (error,), {}) for name in NAMES})
        self.alive = {"a", "b"}
        self.endings: list[Callable[[], None]] = []
        self.asked: list[dict[str, Any]] = []
        self.cancelled: list[bool] = []  # by force?

    def cluster_resources(self) -> dict[str, float]:
        return {"CPU": 4.0}

    def nodes(self) -> list[dict[str, Any]]:
        has = {"CPU": 2.0, "memory": 8.0 * 2**30}
        return [{"NodeID": name, "Alive": name in self.alive, "Resources": has} for name in ("a", "b")]

    def remote(self, **options: Any) -> Callable[[Any], Any]:
        self.asked.append(options)
        return lambda _: self

    def options(self, **options: Any) -> Any:
        self.asked.append(options)
        return SimpleNamespace(remote=self.submit)

    def submit(self, job: Any, log: str) -> Any:
        Path(log).write_text('{"node": "a"}\n{"done": 1, "total": 4, "facts": {}}\n{"said": "half')

        def done() -> Event:
            told: list[Event] = []
            if self.endings:
                self.endings.pop(0)()
            attempt(job, told.append)
            return told[-1]

        return done

    def wait(self, references: list[Any], **_: Any) -> tuple[list[Any], list[Any]]:
        return references[:1], references[1:]

    def get(self, reference: Any, timeout: float) -> Event:  # noqa: ARG002
        ending: Event = reference()
        return ending

    def cancel(self, _reference: Any, *, force: bool) -> None:
        self.cancelled.append(force)

    def shutdown(self) -> None: ...

    def dies(self, name: str, *, with_machine: bool = False) -> Callable[[], None]:
        def ending() -> None:
            if with_machine:
                self.alive.discard("a")
            raise getattr(self.exceptions, name)

        return ending


@pytest.fixture
def ray(monkeypatch: pytest.MonkeyPatch) -> StandIn:
    monkeypatch.setattr(engine_module, "LOOK_EVERY_S", 0.01)
    monkeypatch.setattr(engine_module, "LOST_WITHIN_S", 0.1)
    return StandIn()


def run(ray: StandIn, tasks: list[Task], root: Path) -> tuple[Outcome, list[Event]]:
    events: list[Event] = []
    return run_graph(tasks, Store(root), OnRay(ray, None), events.append), events


def test_a_task_is_given_what_it_needs_and_its_result_is_as_on_one_machine(ray: StandIn, tmp_path: Path) -> None:
    task = toy("one", value=3, resources=Resources(cores=2, memory_gb=4.0))
    outcome, events = run(ray, [task], tmp_path)
    assert outcome.kept[task.digest].result["sum"] == 3
    assert ray.asked[0] == {"max_calls": 1}
    asked = {"num_cpus": 2, "num_gpus": 0.0, "memory": 4 * 2**30, "max_retries": 0, "name": task.title}
    assert ray.asked[1:] == [asked]
    assert isinstance(events[-1], Finished)
    assert os.listdir(tmp_path / ".events") == []


def test_a_worker_that_dies_alone_has_met_the_end_of_memory(ray: StandIn, tmp_path: Path) -> None:
    ray.endings = [ray.dies("WorkerCrashedError"), ray.dies("OutOfMemoryError")]
    first, second, good = toy("first"), toy("second", value=2), toy("good", value=3)
    outcome, _ = run(ray, [first, second, good], tmp_path)
    assert [outcome.failures[task.digest].sentence for task in (first, second)] == [OUT_OF_MEMORY] * 2
    assert good.digest in outcome.kept


def test_a_task_whose_machine_is_lost_is_tried_elsewhere(ray: StandIn, tmp_path: Path) -> None:
    ray.endings = [ray.dies("WorkerCrashedError", with_machine=True)]
    task = toy("one")
    outcome, events = run(ray, [task], tmp_path)
    assert task.digest in outcome.kept
    said = [event.text for event in events if isinstance(event, Said)]
    assert said == ["its machine was lost; another one goes on with it"]
    assert [event.done for event in events if isinstance(event, Advanced)] == [1, 1]


def test_a_task_that_loses_every_machine_fails_in_the_end(ray: StandIn, tmp_path: Path) -> None:
    ray.endings = [ray.dies("NodeDiedError", with_machine=True) for _ in range(engine_module.TRIES)]
    task = toy("one")
    outcome, _ = run(ray, [task], tmp_path)
    assert outcome.failures[task.digest].sentence == "its machine was lost, 4 times; see to the cluster"


def test_a_task_that_fails_by_itself_is_not_tried_again(ray: StandIn, tmp_path: Path) -> None:
    task = toy("bad", does="fail")
    outcome, events = run(ray, [task], tmp_path)
    assert outcome.failures[task.digest].sentence == "the toy is broken; mend it"
    assert len([event for event in events if isinstance(event, Failed)]) == 1


@pytest.mark.parametrize(
    ("wanted", "lacking"),
    [
        (Resources(cores=3), "3 cores"),
        (Resources(gpus=1), "1 cores and 1 GPUs"),
        (Resources(memory_gb=9), "1 cores and 9 GB of memory"),
    ],
)
def test_what_no_machine_has_is_refused(ray: StandIn, wanted: Resources, lacking: str, tmp_path: Path) -> None:
    task = toy("large", resources=wanted)
    outcome, _ = run(ray, [task], tmp_path)
    assert outcome.failures[task.digest].sentence == (
        f"no machine of the cluster has {lacking}; add one, or ask for less"
    )


def test_a_task_is_asked_to_save_and_never_cancelled_by_force(
    ray: StandIn, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ray aborts the process that cancels by force a task whose answer is under way."""
    monkeypatch.setattr(engine_module, "SAVED_WITHIN_S", 0.1)
    saved, late, told = toy("saved"), toy("late", value=2), list[Event]()
    engine = OnRay(ray, None)
    for task in (saved, late):
        engine.start(Job(tmp_path, task, {}, {}), told.append)
    engine.stop()  # the stand-in says that the first one is ready
    assert ray.cancelled == [False, False]
    assert [(type(event), event.task) for event in told if not isinstance(event, Advanced)] == [
        (Finished, saved),
        (Stopped, late),
    ]
