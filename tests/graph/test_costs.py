"""What a graph will take: by closed-form seconds of tasks that nobody runs."""

from dataclasses import replace
from pathlib import Path

import pytest

from aa4d.graph.costs import DONE, EDITED, MISSING, Costs, makespan, plan
from aa4d.graph.engines import Means, engine_of
from aa4d.graph.events import Advanced, Event, Finished, Started
from aa4d.graph.kinds import Kept
from aa4d.graph.remaining import Remaining
from aa4d.graph.scheduler import run_graph
from aa4d.graph.store import Store
from aa4d.graph.task import Task, in_order
from tests.graph.toy import toy


def silent(_: Event) -> None:
    pass


def run(task: Task, root: Path) -> None:
    run_graph([task], Store(root), engine_of("inline", Means()), silent)


def test_seconds_are_of_what_is_alike_else_of_the_kind_and_in_proportion_to_the_work() -> None:
    costs, short = Costs(), replace(toy("short"), units=10.0)
    assert costs.seconds(short) is None
    costs.add(short, 20.0)
    costs.add(short, 40.0)
    assert costs.seconds(replace(short, units=5.0)) == pytest.approx(15.0)
    other = replace(short, alike="another scene", units=100.0)
    assert costs.seconds(other) == pytest.approx(300.0)
    costs.add(other, 100.0)
    assert costs.seconds(other) == pytest.approx(100.0)
    assert costs.seconds(short) == pytest.approx(30.0)


def test_seconds_are_read_beside_the_results_that_took_them(tmp_path: Path) -> None:
    run(toy("slow", seconds=0.2), tmp_path)
    measured = Costs([Store(tmp_path)]).seconds(toy("another", value=9))
    assert measured is not None
    assert 0.2 <= measured < 5


def test_several_at_a_time_wait_for_what_they_need() -> None:
    low = [toy(f"low{i}", value=i) for i in range(4)]
    top = toy("top", *low)
    tasks = in_order([top])
    seconds = {task.digest: 10.0 for task in low} | {top.digest: 5.0}
    assert makespan(seconds, tasks, 1) == 45.0
    assert makespan(seconds, tasks, 2) == 25.0
    assert makespan(seconds, tasks, 9) == 15.0
    del seconds[low[0].digest]  # done
    assert makespan(seconds, tasks, 1) == 35.0
    assert makespan({}, tasks, 1) == 0.0


def test_a_plan_tells_what_is_done_what_was_changed_and_what_is_to_do(tmp_path: Path) -> None:
    low = toy("low")
    top = toy("top", low, value=2)
    run(low, tmp_path)
    store = Store(tmp_path)
    assert [entry.state for entry in plan(in_order([top]), store, Costs([store]))] == [DONE, MISSING]
    before = sorted(tmp_path.rglob("*"))
    (store.folder(low) / "sum.txt").write_text("9")
    assert [entry.state for entry in plan(in_order([top]), store, Costs([store]))] == [EDITED, MISSING]
    assert sorted(tmp_path.rglob("*")) == before, "a plan writes nothing"


def test_the_time_left_is_that_of_running_tasks_by_their_pace_and_of_the_others_by_what_was_measured() -> None:
    first, second = replace(toy("first"), units=100.0), replace(toy("second", value=2), units=100.0)
    now = 0.0
    left = Remaining([first, second], Costs(), 1, clock=lambda: now)
    left(Started(first))
    assert left.seconds() is None
    left(Advanced(first, 0, 100))
    now = 10.0
    left(Advanced(first, 25, 100))
    assert left.seconds() == pytest.approx(30 + 40), "the second one like the first"
    now = 16.0
    assert left.seconds() == pytest.approx(24 + 40)
    left(Finished(first, Kept({}, 44.0, "")))
    assert left.seconds() == pytest.approx(44.0)
    assert left.done == 1
    assert left.share == pytest.approx(0.5)
    left(Finished(second, Kept({}, 1.0, "")))
    assert left.seconds() == 0.0
    assert left.share == 1.0


def test_a_task_that_goes_on_in_the_middle_is_timed_from_there() -> None:
    task = toy("one")
    now = 0.0
    left = Remaining([task], Costs(), 1, clock=lambda: now)
    left(Started(task))
    left(Advanced(task, 60, 100))
    now = 10.0
    left(Advanced(task, 80, 100))
    assert left.seconds() == pytest.approx(10.0)
