"""Graphs of toy tasks, done by every engine that needs nothing but this machine."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from aa4d.errors import InputError, Interrupted
from aa4d.graph.engines import Means, engine_of
from aa4d.graph.events import Advanced, Event, Failed, Finished, Said, Started
from aa4d.graph.kinds import Kind
from aa4d.graph.scheduler import Outcome, check, run_graph
from aa4d.graph.store import Store
from aa4d.graph.task import Task
from tests.graph.toy import toy


class Listener:
    def __init__(self) -> None:
        self.events: list[Event] = []

    def __call__(self, event: Event) -> None:
        self.events.append(event)

    def names(self, kind: type) -> list[str]:
        return [event.task.name for event in self.events if isinstance(event, kind)]

    def made(self) -> list[str]:
        return [event.task.name for event in self.events if isinstance(event, Finished) and not event.before]


def run(tasks: list[Task], root: Path, engine: str = "inline", jobs: int | None = None) -> tuple[Outcome, Listener]:
    listener = Listener()
    return run_graph(tasks, Store(root), engine_of(engine, Means(jobs)), listener), listener


@pytest.mark.parametrize(("engine", "jobs"), [("inline", None), ("processes", 2)])
def test_every_task_is_done_once_after_what_it_needs(tmp_path: Path, engine: str, jobs: int | None) -> None:
    log = tmp_path / "log"
    leaf = toy("leaf", value=1, log=log)
    twin = toy("twin", value=1, log=log)  # the same task under another name
    top = toy("top", toy("left", leaf, value=2, log=log), toy("right", twin, value=3, log=log), value=4)
    outcome, first = run([top], tmp_path / "out", engine, jobs)
    assert outcome.kept[top.digest].result["sum"] == 4 + (2 + 1) + (3 + 1)
    assert sorted(log.read_text().split()) == ["leaf", "left", "right"]
    assert first.names(Started)[0] == "leaf"
    assert first.names(Advanced).count("top") == 10
    again, second = run([top], tmp_path / "out", engine, jobs)
    assert again == outcome
    assert second.names(Started) == []
    assert [event.before for event in second.events if isinstance(event, Finished)] == [True] * 4


@pytest.mark.parametrize(("engine", "jobs"), [("inline", None), ("processes", 2)])
def test_a_failure_stops_what_needs_it_and_nothing_else(tmp_path: Path, engine: str, jobs: int | None) -> None:
    bad, good = toy("bad", does="fail"), toy("good", value=5)
    above, table = toy("above", bad), toy("table", bad, good, partial=True, value=0)
    outcome, _ = run([bad, above, good, table], tmp_path, engine, jobs)
    assert outcome.kept[table.digest].result == {"sum": 5, "missing": ["bad"]}
    assert outcome.failures[bad.digest].sentence == "the toy is broken; mend it"
    skipped = outcome.failures[above.digest]
    assert skipped.because == bad
    assert "not tried, for tests.graph.toy bad failed" in skipped.sentence
    with pytest.raises(
        InputError, match=r"1 of 4 tasks failed, 1 that need them were not tried; first: .*bad: the toy"
    ):
        check(outcome)
    assert not list(tmp_path.glob("*/above*")), "nothing half-made"


def test_a_fault_of_the_program_is_told_of_its_task_alone(tmp_path: Path) -> None:
    bad, good = toy("bad", does="break"), toy("good")
    outcome, _ = run([bad, good], tmp_path)
    assert outcome.failures[bad.digest].sentence == "ZeroDivisionError: by a toy"
    assert good.digest in outcome.kept


@pytest.mark.parametrize(("engine", "jobs"), [("inline", None), ("processes", 2)])
def test_a_full_disk_is_named_leaves_nothing_half_made_and_the_same_graph_continues(
    tmp_path: Path, engine: str, jobs: int | None
) -> None:
    gate = tmp_path / "gate"
    full, good = toy("full", value=7, does="fill", gate=gate), toy("good", value=2)
    outcome, _ = run([full, good], tmp_path / "out", engine, jobs)
    sentence = outcome.failures[full.digest].sentence
    assert sentence.endswith("sum.txt: No space left on device; free some, and run the same command again")
    assert good.digest in outcome.kept
    assert not Store(tmp_path / "out").folder(full).exists()
    gate.touch()
    again, listener = run([full, good], tmp_path / "out", engine, jobs)
    assert listener.made() == ["full"]
    assert again.kept[full.digest].result["sum"] == 7


def test_a_process_that_is_killed_for_memory_fails_alone_and_says_so(tmp_path: Path) -> None:
    bad, good = toy("bad", does="die"), toy("good")
    outcome, _ = run([bad, good], tmp_path, "processes", 2)
    assert "killed (signal 9), as the system does where memory runs out" in outcome.failures[bad.digest].sentence
    assert good.digest in outcome.kept


def test_a_table_is_made_again_when_what_had_failed_is_there(tmp_path: Path) -> None:
    bad = toy("bad", value=7, does="fail", gate=tmp_path / "gate")
    table = toy("table", bad, toy("good", value=5), partial=True, value=0)
    run([table], tmp_path / "out")
    _, again = run([table], tmp_path / "out")
    assert again.made() == [], "the same rows make the same table"
    (tmp_path / "gate").touch()
    outcome, after = run([table], tmp_path / "out")
    assert after.made() == ["bad", "table"]
    assert outcome.kept[table.digest].result == {"sum": 12, "missing": []}


def test_a_changed_setting_repeats_what_depends_on_it_and_going_back_finds_what_was(tmp_path: Path) -> None:
    def graph(value: int) -> list[Task]:
        return [toy("top", toy("a", value=value), toy("b", value=10))]

    run(graph(1), tmp_path)
    _, changed = run(graph(2), tmp_path)
    assert changed.made() == ["a", "top"]
    _, back = run(graph(1), tmp_path)
    assert back.made() == []


def test_a_result_that_is_made_again_to_the_same_content_repeats_nothing_above_it(tmp_path: Path) -> None:
    low = toy("low")
    top = toy("top", low)
    run([top], tmp_path)
    shutil.rmtree(Store(tmp_path).folder(low))
    _, again = run([top], tmp_path)
    assert again.made() == ["low"]


@pytest.mark.parametrize("what", ["content", "record", "removed"])
def test_a_result_that_was_edited_by_hand_is_made_again_and_said(tmp_path: Path, what: str) -> None:
    task = toy("one", value=3)
    run([task], tmp_path)
    folder = Store(tmp_path).folder(task)
    record = folder.with_suffix(".json")
    if what == "content":
        (folder / "sum.txt").write_text("4")
    elif what == "removed":
        (folder / "sum.txt").unlink()
    else:
        record.write_text(json.dumps(json.loads(record.read_text()) | {"seconds": 0.0}))
    outcome, listener = run([task], tmp_path)
    said = [event.text for event in listener.events if isinstance(event, Said)]
    edited = record if what == "record" else folder / "sum.txt"
    assert said == [f"{edited} is not as it was made; {task.title} is made again"]
    assert outcome.kept[task.digest].result["sum"] == 3
    assert (folder / "sum.txt").read_text() == "3"


@pytest.mark.parametrize("left", ["", "[]", "{}", '{"sum": 1, "seconds": NaN}', '{"seconds": "x", "identity": 3}'])
def test_a_damaged_record_costs_no_more_than_the_task_s_time(tmp_path: Path, left: str) -> None:
    task = toy("one", value=3)
    run([task], tmp_path)
    folder = Store(tmp_path).folder(task)
    for ending in (".json", ".part.json"):
        folder.with_name(folder.name + ending).write_text(left)
    assert list(Store(tmp_path).records()) == []
    outcome, _ = run([task], tmp_path)
    assert outcome.kept[task.digest].result["sum"] == 3
    assert run([task], tmp_path)[1].made() == []


def test_a_folder_that_was_touched_copied_or_renamed_is_as_it_was(tmp_path: Path) -> None:
    task = toy("one")
    run([task], tmp_path / "a")
    for path in (tmp_path / "a").rglob("*.txt"):
        os.utime(path)
    shutil.copytree(tmp_path / "a", tmp_path / "b")
    folder = Store(tmp_path / "b").folder(task)
    for path in (folder, folder.with_suffix(".json")):
        path.rename(path.with_name(path.name.replace("one-", "other-")))
    for root in ("a", "b"):
        assert run([task], tmp_path / root)[1].made() == []


def test_seconds_of_interrupted_tries_add_up(tmp_path: Path) -> None:
    task = toy("one", does="fail", seconds=0.1)
    run([task], tmp_path)
    run([task], tmp_path)
    assert Store(tmp_path).spent(task) >= 0.2


def in_place(**settings: Any) -> Task:
    return replace(toy("one", **settings), outputs=("sum.txt",))


def test_a_result_can_be_made_where_it_lies(tmp_path: Path) -> None:
    run([in_place(value=3)], tmp_path)
    assert (tmp_path / "sum.txt").read_text() == "3"
    assert run([in_place(value=3)], tmp_path)[1].made() == []
    (tmp_path / "sum.txt").write_text("4")
    _, listener = run([in_place(value=3)], tmp_path)
    said = [event.text for event in listener.events if isinstance(event, Said)]
    assert said == [f"{tmp_path / 'sum.txt'} is not as it was made; {toy('one').title} is made again"]
    assert (tmp_path / "sum.txt").read_text() == "3"
    assert run([in_place(value=5)], tmp_path)[1].made() == ["one"]
    assert len(list(Store(tmp_path).records())) == 1, "a record is that of the result that is there"


def test_seconds_of_a_result_in_place_are_those_of_the_tries_that_made_it(tmp_path: Path) -> None:
    gate, store = tmp_path / "gate", Store(tmp_path)
    run([in_place(does="fail", seconds=0.1, gate=gate)], tmp_path)
    assert store.spent(in_place(does="fail", seconds=0.1)) >= 0.1
    assert store.spent(in_place(value=9)) == 0.0, "another task begins anew"
    gate.touch()
    first, _ = run([in_place(does="fail", seconds=0.1, gate=gate)], tmp_path)
    (kept,) = first.kept.values()
    assert kept.seconds is not None
    assert kept.seconds >= 0.2


def test_a_result_in_place_that_was_looked_at_and_left_as_it_was_took_what_it_took(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, _ = run([in_place(value=3, seconds=0.1)], tmp_path)
    monkeypatch.setattr("tests.graph.toy.KIND", Kind(lambda _: {}))
    again, listener = run([in_place(value=3)], tmp_path)
    assert listener.made() == ["one"]
    assert [kept.seconds for kept in again.kept.values()] == [kept.seconds for kept in first.kept.values()]


def test_what_a_task_has_not_made_is_a_failure_of_that_task(tmp_path: Path) -> None:
    task = replace(toy("one"), outputs=("sum.txt", "plot.png"))
    outcome, _ = run([task], tmp_path)
    assert f"{tmp_path / 'plot.png'}: {task.title} has not made it" in outcome.failures[task.digest].sentence


PROGRAM = """
import sys
from pathlib import Path
from aa4d.graph.engines import Means, engine_of
from aa4d.graph.scheduler import run_graph
from aa4d.graph.store import Store
from aa4d.errors import Interrupted
from tests.graph.toy import toy
if __name__ == "__main__":
    out, gate = Path(sys.argv[1]), Path(sys.argv[2])
    leaf = toy("leaf", log=out.parent / "log")
    tasks = [toy(f"t{i}", leaf, value=i, gate=gate, log=out.parent / "log") for i in range(2)]
    try:
        run_graph(tasks, Store(out), engine_of("processes", Means(2)), lambda event: None)
    except Interrupted as stop:
        sys.exit(str(stop))
"""


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
def test_a_killed_or_stopped_graph_leaves_no_process_and_continues(tmp_path: Path, how: signal.Signals) -> None:
    program, out, gate, log = tmp_path / "program.py", tmp_path / "out", tmp_path / "gate", tmp_path / "log"
    program.write_text(PROGRAM)
    command = [sys.executable, str(program), str(out), str(gate)]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).resolve().parents[2])}
    process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60
    while not log.exists() or len(log.read_text().split()) < 3:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(how)
    _, said = process.communicate(timeout=30)
    if how != signal.SIGKILL:
        assert "stopped; 1 of 3 tasks done, and the same command continues" in said
    gate.touch()
    subprocess.run(command, env=environment, check=True, timeout=60)
    assert log.read_text().split().count("leaf") == 1
    sums = sorted(path.read_text() for path in out.rglob("sum.txt"))
    assert sums == ["1", "1", "2"]
    assert not list(out.rglob("*.part*"))


def test_ctrl_c_in_this_process_is_interrupted(tmp_path: Path) -> None:
    def interrupt(event: Event) -> None:
        if isinstance(event, Advanced):
            raise KeyboardInterrupt

    with pytest.raises(Interrupted, match="stopped; 0 of 1 task done"):
        run_graph([toy("one")], Store(tmp_path), engine_of("inline", Means()), interrupt)
    assert run([toy("one")], tmp_path)[0].failures == {}


def test_several_jobs_need_several_processes() -> None:
    with pytest.raises(InputError, match="--jobs 2: the engine inline does one task at a time"):
        engine_of("inline", Means(2))


def test_a_failure_is_an_event_with_its_task(tmp_path: Path) -> None:
    _, listener = run([toy("bad", does="fail")], tmp_path)
    assert listener.names(Failed) == ["bad"]
