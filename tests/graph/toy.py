"""A kind of task for tests: adds up what it needs, and does as it is told; `toy(...)` makes one."""

import errno
import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aa4d.errors import InputError
from aa4d.graph.call import Call
from aa4d.graph.kinds import Kind
from aa4d.graph.task import Resources, Task, location


@dataclass(frozen=True)
class Toy:
    value: int = 1
    seconds: float = 0.0
    does: str = ""  # "fail", "break", "die", "fill"
    log: Path | None = location(None)  # a line for every try
    gate: Path | None = location(None)  # a file that lets it through, or mends it


def run(call: Call) -> dict[str, Any]:
    toy: Toy = call.task.settings
    if toy.log is not None:
        with toy.log.open("a") as log:
            log.write(f"{call.task.name}\n")
    steps = 10
    for step in range(steps):
        (call.folder / "at.txt").write_text(str(step))
        call.advance(step + 1, steps)
        time.sleep(toy.seconds / steps)
    is_open = toy.gate is not None and toy.gate.exists()
    if toy.does == "fail" and not is_open:
        raise InputError("the toy is broken; mend it")
    if toy.does == "fill" and not is_open:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(call.folder / "sum.txt"))
    if toy.does == "break":
        raise ZeroDivisionError("by a toy")
    if toy.does == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    while toy.gate is not None and not toy.gate.exists():
        time.sleep(0.05)
    total = toy.value + sum(int((need.folder / "sum.txt").read_text()) for need in call.needs)
    (call.folder / "sum.txt").write_text(str(total))
    return {"sum": total, "missing": sorted(call.failures)}


KIND = Kind(run)


def toy(name: str, *needs: Task, resources: Resources = Resources(), partial: bool = False, **settings: Any) -> Task:
    return Task(__name__, name, Toy(**settings), needs, resources, partial=partial, alike="toy")
