"""What the graph costs beside bare commands: twenty tasks, one at a time and two, and again when all is done.

    python -m aa4d.experiments.graph_overhead --out DIR --finished FILE FOLDER

A task computes for some seconds with torch, as training does, and writes a megabyte; the bare command does the same in
a Python of its own. Processor seconds are those of all processes: other programs on the machine do not count. FILE is
an experiment that has been run to its end in FOLDER: `aa4d experiment` is measured on it once more.
"""

from __future__ import annotations

import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import arg

from aa4d.experiments.program import run_as_program
from aa4d.files import make_folder, write_json
from aa4d.graph.call import Call
from aa4d.graph.engines import Means, engine_of
from aa4d.graph.kinds import Kind
from aa4d.graph.scheduler import check, run_graph
from aa4d.graph.store import Store
from aa4d.graph.task import Task

MEGABYTE = 1 << 20
BARE = "import sys; from aa4d.experiments.graph_overhead import work; work(float(sys.argv[1]), sys.argv[2])"


@dataclass(frozen=True)
class Work:
    number: int
    seconds: float  # of the processor


def work(seconds: float, folder: str) -> None:
    """Compute on one thread, and leave a file."""
    import torch

    torch.set_num_threads(1)
    matrix = torch.eye(256)
    until = time.process_time() + seconds
    while time.process_time() < until:
        matrix = matrix @ matrix
    Path(folder, "file").write_bytes(bytes(MEGABYTE))


def run(call: Call) -> dict[str, Any]:
    work(call.task.settings.seconds, str(call.folder))
    return {}


KIND = Kind(run)


def measured(what: str, do: Callable[[], None]) -> dict[str, Any]:
    def processor() -> float:
        used = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
        return sum(usage.ru_utime + usage.ru_stime for usage in used)

    before, started = processor(), time.perf_counter()
    do()
    row = {"what": what, "seconds": time.perf_counter() - started, "processor_s": processor() - before}
    print(f"{what:24} {row['seconds']:8.2f} s  {row['processor_s']:8.2f} s of the processor", flush=True)
    return row


def main(
    out: Annotated[Path, arg(help="Folder for what the tasks write, and table.json.")],
    tasks: int = 20,
    seconds: Annotated[float, arg(help="Processor seconds of a task, besides starting Python and torch.")] = 10.0,
    finished: Annotated[
        tuple[Path, Path] | None, arg(help="An experiment file, and the folder in which it has been run to its end.")
    ] = None,
) -> None:
    make_folder(out)
    graph = [Task(__spec__.name, f"task {n}", Work(n, seconds), alike="work") for n in range(tasks)]

    def bare() -> None:
        for number in range(tasks):
            folder = out / "bare" / str(number)
            make_folder(folder)
            subprocess.run([sys.executable, "-c", BARE, str(seconds), str(folder)], check=True)

    def by(engine: str, jobs: int, folder: str) -> Callable[[], None]:
        def do() -> None:
            check(run_graph(graph, Store(out / folder), engine_of(engine, Means(jobs)), lambda _: None))

        return do

    def again() -> None:
        file, folder = finished or (Path(), Path())
        command = [sys.executable, "-m", "aa4d", "experiment", str(file), "--out", str(folder)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)

    for folder in ("bare", "one", "two"):
        shutil.rmtree(out / folder, ignore_errors=True)
    steps = {
        "bare commands": bare,
        "graph, one at a time": by("processes", 1, "one"),
        "graph, two at a time": by("processes", 2, "two"),
        "graph, all done": by("processes", 1, "one"),
    }
    if finished is not None:
        steps["aa4d experiment, all done"] = again
    rows: list[dict[str, Any]] = []
    for what, do in steps.items():
        row = measured(what, do)
        if what in ("graph, one at a time", "graph, two at a time"):
            row["over_bare_percent"] = 100 * (row["processor_s"] / rows[0]["processor_s"] - 1)
        rows.append(row)
        write_json(out / "table.json", {"rows": rows})


if __name__ == "__main__":
    run_as_program(main)
