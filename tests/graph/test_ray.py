"""The engine ray: a real cluster of two nodes on this machine, one of which is lost in the middle."""

import signal
import socket
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from aa4d.errors import InputError, Interrupted
from aa4d.graph.engines import Means, engine_of
from aa4d.graph.events import Advanced, Event, Failed, Finished, Said
from aa4d.graph.scheduler import run_graph
from aa4d.graph.store import Store
from aa4d.graph.task import Resources, Task
from tests.graph.toy import toy

pytest.importorskip("ray", reason='Ray is not installed; pip install "aa4d[cluster]"')

LONGEST_S = 240  # of a test, the start of the cluster included
START_S = 120  # of a node, where the machine is busy; Ray gives it 20


@pytest.fixture(autouse=True)
def bounded() -> Iterator[None]:
    """A cluster that never answers is a failure, and no endless wait."""

    def give_up(_number: int, _frame: Any) -> None:
        raise TimeoutError(f"not done within {LONGEST_S} s")

    before = signal.signal(signal.SIGALRM, give_up)
    signal.alarm(LONGEST_S)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Of one node with two cores, the head."""
    from ray._private import ray_constants
    from ray.cluster_utils import Cluster

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ray_constants, "NUM_REDIS_GET_RETRIES", START_S)  # one look a second
        made = Cluster(initialize_head=True, head_node_args={"num_cpus": 2, "include_dashboard": False})
        yield made
        made.shutdown()


def graph(log: Path, gate: Path | None = None) -> Task:
    leaves = [toy(f"leaf{i}", value=i, gate=gate, log=log) for i in range(4)]
    return toy("top", *leaves, value=100, log=log)


def test_a_cluster_gives_the_results_of_one_process(cluster: Any, tmp_path: Path) -> None:
    leaves = [toy(f"leaf{i}", value=i) for i in range(2)]
    top, events = toy("top", *leaves, value=100), list[Event]()
    expected = run_graph([top], Store(tmp_path / "one"), engine_of("inline", Means()), lambda _: None)
    engine = engine_of("ray", Means(address=cluster.address))
    outcome = run_graph([top], Store(tmp_path / "two"), engine, events.append)
    assert {d: (k.result, k.content) for d, k in outcome.kept.items()} == {
        d: (k.result, k.content) for d, k in expected.kept.items()
    }
    assert {event.task.name for event in events if isinstance(event, Advanced)} == {"leaf0", "leaf1", "top"}


@pytest.mark.slow
def test_a_lost_node_changes_nothing_but_the_time(cluster: Any, tmp_path: Path) -> None:
    alone, gate, log = graph(tmp_path / "alone"), tmp_path / "gate", tmp_path / "log"
    expected = run_graph([alone], Store(tmp_path / "one"), engine_of("inline", Means()), lambda _: None)
    second = cluster.add_node(num_cpus=2)
    events: list[Event] = []
    lost: list[str] = []

    def lose_a_node_once_all_run(event: Event) -> None:
        nonlocal second
        events.append(event)
        if second is not None and len({e.task.name for e in events if isinstance(e, Advanced)}) == 4:
            cluster.remove_node(second, allow_graceful=False)
            second = None
        if isinstance(event, Said) and "its machine was lost" in event.text:
            lost.append(event.task.name)
            gate.touch()

    engine = engine_of("ray", Means(address=cluster.address))
    assert engine.slots == 4
    outcome = run_graph([graph(log, gate)], Store(tmp_path / "two"), engine, lose_a_node_once_all_run)
    assert {d: kept.result for d, kept in outcome.kept.items()} == {d: k.result for d, k in expected.kept.items()}
    assert {d: kept.content for d, kept in outcome.kept.items()} == {d: k.content for d, k in expected.kept.items()}
    assert 1 <= len(lost) <= 2
    tries = log.read_text().split()
    assert {name: tries.count(name) - 1 for name in set(tries) if tries.count(name) > 1} == dict.fromkeys(lost, 1)


@pytest.mark.slow
def test_a_worker_that_the_system_kills_for_memory_fails_alone_and_says_so(
    cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("aa4d.graph.engines.ray.LOST_WITHIN_S", 2.0)  # no node is lost here
    bad, good = toy("bad", does="die"), toy("good")
    engine = engine_of("ray", Means(address=cluster.address))
    outcome = run_graph([bad, good], Store(tmp_path), engine, lambda _: None)
    assert "killed (signal 9), as the system does where memory runs out" in outcome.failures[bad.digest].sentence
    assert good.digest in outcome.kept


@pytest.mark.slow
def test_a_task_for_which_no_machine_is_large_enough_is_refused_and_one_that_is_stopped_continues(
    cluster: Any, tmp_path: Path
) -> None:
    large = replace(toy("large"), resources=Resources(cores=64, gpus=1))
    gated = toy("gated", value=2, gate=tmp_path / "gate")
    events: list[Event] = []

    def stop_once_it_runs(event: Event) -> None:
        events.append(event)
        if isinstance(event, Advanced):
            raise KeyboardInterrupt

    engine = engine_of("ray", Means(address=cluster.address))
    with pytest.raises(Interrupted, match="stopped; 0 of 2 tasks done"):
        run_graph([large, gated], Store(tmp_path), engine, stop_once_it_runs)
    failed = next(event for event in events if isinstance(event, Failed))
    assert failed.sentence == "no machine of the cluster has 64 cores and 1 GPUs; add one, or ask for less"
    (tmp_path / "gate").touch()
    again = run_graph([gated], Store(tmp_path), engine_of("ray", Means(address=cluster.address)), events.append)
    assert again.kept[gated.digest].result["sum"] == 2
    assert isinstance(events[-1], Finished)


def test_an_address_where_nobody_answers_is_refused_at_once(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # and does not listen
        address = f"127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(
            InputError, match=rf"--address {address}: nobody answers there .*; start one with `ray start"
        ):
            engine_of("ray", Means(address=address))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_an_address_where_something_else_answers_is_refused_after_a_bounded_wait(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("aa4d.graph.engines.ray.ANSWERED_WITHIN_S", 5.0)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        threading.Thread(target=silent.accept, daemon=True).start()
        started = time.monotonic()
        with pytest.raises(InputError, match="no Ray cluster answers there within 5 s"):
            engine_of("ray", Means(address=f"127.0.0.1:{silent.getsockname()[1]}"))
        assert time.monotonic() - started < 20


@pytest.mark.parametrize(
    ("address", "says"),
    [
        (None, "say which cluster with --address HOST:PORT"),
        ("head", "--address head: write HOST:PORT, or auto"),
        ("head:99999", "--address head:99999: write HOST:PORT, or auto"),
    ],
)
def test_what_is_no_address_is_refused(address: str | None, says: str) -> None:
    with pytest.raises(InputError, match=says):
        engine_of("ray", Means(address=address))


def test_without_ray_the_engine_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(InputError, match=r'Ray is not installed; pip install "aa4d\[cluster\]"'):
        engine_of("ray", Means(address="auto"))
