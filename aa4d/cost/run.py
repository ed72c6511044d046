"""`aa4d cost`: the graph of the panels is run, and the report is written of whatever came of it."""

from __future__ import annotations

import csv
import io
import json
import time
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from aa4d import __version__
from aa4d.capture.reader import read_capture
from aa4d.console import console, graph_listener
from aa4d.cost import PANELS, expected, panel_of
from aa4d.cost.machine import instruction_set, load_average, machine
from aa4d.cost.panel import Measurement, Panel, Setup
from aa4d.cost.report import write_page
from aa4d.cost.rows import Row, points_of, rows_of
from aa4d.errors import InputError
from aa4d.experiments.run_file import stores_of, summary
from aa4d.files import claimed, write_json, write_text
from aa4d.graph.costs import DONE, Costs, plan
from aa4d.graph.engines import Means, engine_of
from aa4d.graph.scheduler import Outcome, check, run_graph
from aa4d.graph.store import Store
from aa4d.graph.task import Task, canonical, in_order
from aa4d.output_folder import claim_folder, index_in

INDEX = "run.json"
WHAT = "a cost report"
JSON, TABLE, PAGE = "cost.json", "cost.csv", "cost.html"


@dataclass(frozen=True)
class Chosen:
    """Panels by name, what each measures, and why others are left out."""

    panels: dict[str, Panel]
    measurements: dict[str, tuple[Measurement, ...]]
    left_out: dict[str, str]

    @property
    def tasks(self) -> tuple[Task, ...]:
        return in_order(m.task for measurements in self.measurements.values() for m in measurements)


def choose(setup: Setup, names: tuple[str, ...] | None) -> Chosen:
    """The panels of these names, or all, that can be measured here.

    Raises:
        InputError: none can, the capture cannot be read, or it is named and none of them uses it.
    """
    panels = {name: panel_of(name) for name in PANELS if not names or name in names}
    reasons = {name: panel.missing(setup) for name, panel in panels.items()}
    left_out = {name: reason for name, reason in reasons.items() if reason is not None}
    measurements = {name: panel.measurements(setup) for name, panel in panels.items() if name not in left_out}
    if not measurements:
        name, reason = next(iter(left_out.items()))
        raise InputError(f"no panel can be measured here; {name}: {reason}")
    if setup.capture is not None and not uses_capture(setup, sum(measurements.values(), ())):
        raise InputError(f"--capture {setup.capture}: has no effect on {', '.join(measurements)}; leave it out")
    return Chosen(panels, measurements, left_out)


def uses_capture(setup: Setup, measurements: tuple[Measurement, ...]) -> bool:
    """True where measurements, or what they need, depend on the capture that `setup` names."""
    assert setup.capture is not None
    digest = read_capture(setup.capture).identity.digest()
    tasks = in_order(measurement.task for measurement in measurements)
    return any(digest in json.dumps(canonical(task.settings)) for task in tasks)


def show_plan(setup: Setup, names: tuple[str, ...] | None, out: Path, costs_of: tuple[Path, ...]) -> None:
    """Print every task with its state, and how long all will take. Writes nothing.

    Raises:
        InputError: no panel can be measured, or `out` holds something else.
    """
    chosen = choose(setup, names)
    tasks, stores = chosen.tasks, (Store(out), *stores_of(costs_of))
    index_in(out, INDEX, _wanted(setup), WHAT)
    for entry in plan(tasks, Store(out), _costs(tasks, setup, stores)):
        console.print(f"{entry.task.title}: {entry.state}", highlight=False, soft_wrap=True)
    for name, reason in chosen.left_out.items():
        console.print(f"{name} is left out: {reason}", highlight=False, soft_wrap=True)
    _foretell(tasks, setup, stores)


def run_cost(setup: Setup, names: tuple[str, ...] | None, out: Path, costs_of: tuple[Path, ...]) -> None:
    """Measure what has not been measured yet, and write `JSON`, `TABLE` and `PAGE`.

    Raises:
        InputError: no panel can be measured; `out` holds something else, or another process works there; or, once the
            report is written, a task failed.
        Interrupted: Ctrl-C; what is measured is kept, and the same command continues.
    """
    chosen = choose(setup, names)
    stores = (Store(out), *stores_of(costs_of))
    with ExitStack() as stack:
        claim_folder(out, INDEX, _wanted(setup), WHAT)
        stack.enter_context(claimed(out, "measuring what accuracy costs"))
        _foretell(chosen.tasks, setup, stores)
        load, started = load_average(), time.perf_counter()
        with graph_listener(1, _costs(chosen.tasks, setup, stores)) as listen:
            # One after the other in this process: nothing of ours runs beside what is timed.
            outcome = run_graph(chosen.tasks, Store(out), engine_of("inline", Means()), listen(chosen.tasks))
        session = {"seconds": time.perf_counter() - started, "load_before": load, "load_after": load_average()}
        _write(setup, chosen, outcome, session, out)
    console.print(
        f"report: {out / PAGE}\ntable:  {out / TABLE}, {out / JSON}",
        highlight=False,
        soft_wrap=True,
    )
    check(outcome)


def _wanted(setup: Setup) -> dict[str, Any]:
    """What a report in its folder is of. Raises InputError where the capture cannot be read."""
    capture = None if setup.capture is None else read_capture(setup.capture).identity.digest()
    return {"size": setup.size.name, "capture": capture, "machine": machine()}


def _costs(tasks: tuple[Task, ...], setup: Setup, stores: tuple[Store, ...]) -> Costs:
    return expected.costs(tasks, setup.size.name, stores)


def _foretell(tasks: tuple[Task, ...], setup: Setup, stores: tuple[Store, ...]) -> None:
    """Say how long the tasks will take, by what lies in stores, the first of which is that of the report."""
    planned = plan(tasks, stores[0], _costs(tasks, setup, stores))
    is_measured = any(True for store in stores for _ in store.records())
    by = "by what was measured before" if is_measured else "by a first estimate, for two idle cores"
    ending = "" if all(entry.state == DONE for entry in planned) else f", {by}"
    console.print(f"{setup.size.name}: {summary(planned, tasks, 1)}{ending}", highlight=False, soft_wrap=True)


def _write(setup: Setup, chosen: Chosen, outcome: Outcome, session: dict[str, Any], out: Path) -> None:
    results = {digest: kept.result for digest, kept in outcome.kept.items()}
    rows: list[Row] = []
    for name, measurements in chosen.measurements.items():
        rows += rows_of(name, chosen.panels[name], points_of(measurements, results))
    failed = {
        name: sentences
        for name, measurements in chosen.measurements.items()
        if (sentences := [f.sentence for m in measurements if (f := outcome.failures.get(m.task.digest)) is not None])
    }
    report = {
        "size": setup.size.name,
        "schedule": setup.size.schedule,
        "version": __version__,
        "date": datetime.now().astimezone().isoformat(timespec="seconds"),
        "capture": None if setup.capture is None else setup.capture.name,
        "machine": machine() | {"instruction_set": instruction_set()},
        "load": _loads(results) | {key: session[key] for key in ("load_before", "load_after")},
        "seconds": session["seconds"],  # of this session alone, where several were needed
        "left_out": chosen.left_out,
        "failed": failed,
        "rows": rows,
    }
    write_json(out / JSON, report)
    write_text(out / TABLE, as_csv(rows))
    write_page(out / PAGE, report, {name: chosen.panels[name] for name in chosen.panels})


def _loads(results: dict[str, dict[str, Any]]) -> dict[str, float]:
    """The least and the greatest load average at the beginning of a measurement."""
    found = [load for result in results.values() if isinstance(load := result.get("load"), float)]
    return {"least": round(min(found), 2), "greatest": round(max(found), 2)} if found else {}


def as_csv(rows: list[Row]) -> str:
    """One line a point; what panels add beside quality and time stands in columns of its own."""
    flat = [{**{k: v for k, v in row.items() if k != "more"}, **row["more"]} for row in rows]
    columns = list(dict.fromkeys(key for row in flat for key in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(flat)
    return text.getvalue()
