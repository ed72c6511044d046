"""What is left of a graph's events: a file of lines, and TensorBoard's curves."""

import json
from pathlib import Path
from typing import Any

import pytest

from aa4d.graph.engines import Means, engine_of
from aa4d.graph.event_log import EventLog, together
from aa4d.graph.events import Advanced, Event, Finished, Started
from aa4d.graph.kinds import Kept
from aa4d.graph.scheduler import run_graph
from aa4d.graph.store import Store
from tests.graph.toy import toy


def lines(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_everything_that_happens_is_a_line_and_a_second_run_adds_what_is_new(tmp_path: Path) -> None:
    good, bad, heard = toy("good"), toy("bad", value=2, does="fail"), list[Event]()
    path = tmp_path / "events.jsonl"

    def run() -> None:
        listeners = together(EventLog(path), heard.append)
        run_graph([toy("top", good, bad), good], Store(tmp_path), engine_of("inline", Means()), listeners)

    run()
    told = [(line["event"], line["task"].split()[1]) for line in lines(path) if line["event"] != "advanced"]
    assert told == [
        ("started", "good"),
        ("finished", "good"),
        ("started", "bad"),
        ("failed", "bad"),
        ("failed", "top"),
    ]
    assert next(line for line in lines(path) if line["event"] == "failed")["sentence"] == "the toy is broken; mend it"
    assert {type(event).__name__.lower() for event in heard} == {line["event"] for line in lines(path)}
    before = len(lines(path))
    run()
    new = lines(path)[before:]
    assert {line["task"].split()[1] for line in new} == {"bad", "top"}, "what was done before is no news"


def test_of_a_task_s_advances_one_now_and_then_and_the_last_are_written(tmp_path: Path) -> None:
    task, now = toy("one"), 0.0
    log = EventLog(tmp_path / "events.jsonl", clock=lambda: now)
    for done in range(101):
        log(Advanced(task, done, 100, {"loss": 0.5}))
        now += 1.0
    written = lines(tmp_path / "events.jsonl")
    assert [line["done"] for line in written] == list(range(0, 101, 5))
    assert written[0] == {"at_s": 0.0, "event": "advanced", "task": task.title, "done": 0, "total": 100, "loss": 0.5}


def test_a_log_that_cannot_be_written_stops_nothing(tmp_path: Path) -> None:
    EventLog(tmp_path / "no such folder" / "events.jsonl")(Started(toy("one")))
    assert not list(tmp_path.iterdir())


def test_facts_are_curves_by_task(tmp_path: Path) -> None:
    event_accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    from aa4d.graph.event_log import Curves
    from aa4d.training.history import board

    curves = Curves(tmp_path, board)
    task = toy("crossroads, full, seed 0")
    for done in (10, 20):
        curves(Advanced(task, done, 20, {"loss": done / 100}))
    curves(Finished(task, Kept({}, 1.0, "")))
    events = event_accumulator.EventAccumulator(str(tmp_path / task.name))
    events.Reload()
    (tag,) = events.Tags()["scalars"]
    assert tag == f"{task.kind}/loss"
    assert [(e.step, round(e.value, 6)) for e in events.Scalars(tag)] == [(10, 0.1), (20, 0.2)]
