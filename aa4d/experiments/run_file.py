"""`aa4d experiment`: an experiment file is run, or it is shown what would be run and how long it would take."""

from __future__ import annotations

import importlib.util
from contextlib import ExitStack
from pathlib import Path

from aa4d.console import console, graph_listener, words_of
from aa4d.errors import InputError
from aa4d.experiments.command import print_rows
from aa4d.experiments.experiment_file import read_experiment
from aa4d.experiments.graphs import TABLES, experiment_graph, part_of
from aa4d.experiments.scene_check import check_scenes
from aa4d.experiments.variants import Experiment, Variant
from aa4d.files import claimed, whole_file
from aa4d.graph.costs import DONE, Costs, Planned, makespan, plan
from aa4d.graph.engines import Means, engine_of
from aa4d.graph.event_log import LOG, Curves, EventLog, together
from aa4d.graph.scheduler import check, run_graph
from aa4d.graph.store import Store
from aa4d.graph.task import Task, in_order
from aa4d.output_folder import claim_folder, index_in
from aa4d.reports.report import closing_line
from aa4d.words import counted

INDEX = "experiment.json"
COPY = "experiment.toml"
WHAT = "an experiment"


def run_file(
    path: Path,
    out: Path,
    engine: str,
    means: Means,
    part: tuple[int, int] | None,
    costs_of: tuple[Path, ...],
    *,
    tensorboard: bool,
) -> None:
    """Raises InputError for what cannot be run, and, once all others are done, where a task failed."""
    if tensorboard and importlib.util.find_spec("tensorboard") is None:
        raise InputError("--tensorboard: needs the package tensorboard; pip install tensorboard")
    tables = experiment_graph(file := read_experiment(path))
    tasks = (tables,) if part is None else part_of(tables, *part)
    others = stores_of(costs_of)
    check_scenes(path, in_order(tasks), store := Store(out))
    worker = engine_of(engine, means)
    with ExitStack() as stack:
        stack.callback(worker.close)
        claim_folder(out, INDEX, {"experiment": path.stem}, WHAT)
        mine = out if part is None else out / "parts" / f"{part[0]}-of-{part[1]}"
        stack.enter_context(claimed(mine, "running an experiment"))
        with whole_file(out / COPY) as temporary:
            temporary.write_bytes(path.read_bytes())
        with graph_listener(worker.slots, Costs((Store(out), *others))) as listen:
            tell = together(listen(in_order(tasks)), EventLog(mine / LOG))
            if tensorboard:
                from aa4d.training.history import board

                tell = together(tell, Curves(mine / "tensorboard", board))
            outcome = run_graph(tasks, store, worker, tell)
    if part is None:
        results = [outcome.kept.get(need.digest) for need in tables.needs]
        rows = tables.settings.rows({place: kept.result for place, kept in enumerate(results) if kept is not None})
        variants = tuple(Variant(name) for name in file.variants)
        if rows:
            print_rows(Experiment("experiment", file.head.title, variants), rows)
            console.print(f"tables: {out / TABLES}\n{closing_line(out)}", highlight=False, soft_wrap=True)
    check(outcome)


def show_plan(path: Path, out: Path, slots: int, part: tuple[int, int] | None, costs_of: tuple[Path, ...]) -> None:
    """Print every task with its state and its seconds, and how long all will take. Writes nothing.

    Raises:
        InputError: see `run_file`.
    """
    tables = experiment_graph(read_experiment(path))
    index_in(out, INDEX, {"experiment": path.stem}, WHAT)
    tasks = in_order((tables,) if part is None else part_of(tables, *part))
    check_scenes(path, tasks, Store(out))
    planned = plan(tasks, Store(out), Costs((Store(out), *stores_of(costs_of))))
    for entry in planned:
        about = "" if entry.state == DONE or entry.seconds is None else f", about {words_of(entry.seconds)}"
        console.print(f"{entry.task.title}: {entry.state}{about}", highlight=False, soft_wrap=True)
    console.print(summary(planned, tasks, slots), highlight=False, soft_wrap=True)


def stores_of(costs_of: tuple[Path, ...]) -> tuple[Store, ...]:
    """What was measured in the folders that --costs names; one that holds none of it is said.

    Raises:
        InputError: one is not there.
    """
    for folder in costs_of:
        if not folder.is_dir():
            raise InputError(
                f"--costs {folder}: no such folder; name one that `aa4d experiment` or `aa4d cost` has made"
            )
    stores = tuple(map(Store, costs_of))
    for store in stores:
        if not any(True for _ in store.records()):
            console.print(f"--costs {store.root}: holds nothing that was measured", highlight=False, soft_wrap=True)
    return stores


def summary(planned: list[Planned], tasks: tuple[Task, ...], slots: int) -> str:
    """How long what is to do will take, in a sentence."""
    to_do = [entry for entry in planned if entry.state != DONE]
    if not to_do:
        return f"all is done: {counted(len(planned), 'task')}"
    known = {entry.task.digest: entry.seconds for entry in to_do if entry.seconds is not None}
    begin = f"{len(to_do)} of {counted(len(planned), 'task')} to do, {slots} at a time"
    if not known:
        return f"{begin}; how long they take is not known: none of their kinds has been measured (--costs)"
    unknown = sorted({entry.task.kind for entry in to_do if entry.seconds is None})
    also = f", and what {' and '.join(unknown)} takes, which has not been measured" if unknown else ""
    return f"{begin}: about {words_of(makespan(known, tasks, slots))}{also}"


def read_part(text: str) -> tuple[int, int]:
    """ "3/20" as numbers. Raises InputError for what is none."""
    number, slash, parts = text.partition("/")
    if not slash or not number.isdecimal() or not parts.isdecimal() or not 1 <= int(number) <= int(parts):
        raise InputError(f"--part {text}: write which of how many, from 1 on, for instance 3/20")
    return int(number), int(parts)
