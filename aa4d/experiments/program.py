"""Measuring programs that are no command of `aa4d`: `python -m aa4d.experiments.NAME`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import tyro

from aa4d.console import graph_listener
from aa4d.errors import InputError, Interrupted
from aa4d.files import claimed, write_json
from aa4d.graph.costs import Costs
from aa4d.graph.engines import Means, engine_of
from aa4d.graph.scheduler import check, run_graph
from aa4d.graph.store import Store
from aa4d.graph.task import Task

TABLE = "table.json"


def run_as_program(main: Callable[..., None]) -> None:
    """Run `main` with the arguments of the command line. Bad input is one sentence, and the exit code is 2."""
    try:
        tyro.cli(main)
    except InputError as error:
        print(error, file=sys.stderr)
        sys.exit(2)
    except Interrupted as stop:
        print(stop, file=sys.stderr)
        sys.exit(130)


def rows_of_tasks(tasks: Sequence[Task], out: Path, jobs: int = 1) -> list[dict[str, Any]]:
    """The results of tasks, a row each, also written to `TABLE`; those that are in `out` already are taken from there.

    Raises:
        InputError: a task failed, once the others are done; or another process works in `out`.
        Interrupted: Ctrl-C; what was running is saved.
    """
    store = Store(out)
    with claimed(out, "measuring"), graph_listener(jobs, Costs([store])) as listen:
        outcome = run_graph(tasks, store, engine_of("processes", Means(jobs)), listen(tasks))
        rows = [outcome.kept[task.digest].result for task in tasks if task.digest in outcome.kept]
        write_json(out / TABLE, {"rows": rows})
    check(outcome)
    return rows
