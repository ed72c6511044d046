"""`python -m tests.faults.kill`: each command killed at random moments, and run again.

After `kill -9` whatever it had started ends too, and the same command comes to the same result as one that nobody
disturbed, with no unfinished file left.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from aa4d.files import write_json
from tests.faults import commands
from tests.faults.commands import LONGEST_S, Command, living, prepare, run, start, wait, wrong_with
from tests.faults.full import import_all, in_own_process
from tests.faults.tree import contents, differences, unfinished

PATIENCE_S = 30.0  # after which nothing that a killed command had started may run


@dataclass
class Bench:
    """One command, what it makes undisturbed, and how long that takes."""

    command: Command
    inputs: Path
    folder: Path
    result: dict[str, Any] = field(default_factory=dict)
    seconds: float = 0.0
    same: int = 0  # moments after which the result was that of the undisturbed command

    @property
    def log(self) -> Path:
        return self.folder.with_suffix(".log")

    def clear(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir(parents=True)
        prepare(self.command, self.inputs, self.folder)

    def held(self) -> dict[str, Any]:
        return {name: value for name, value in contents(self.folder).items() if not name.startswith("tmp/")}

    def undisturbed(self) -> None:
        self.clear()
        ended = run(self.command, self.inputs, self.folder, self.log)
        assert ended.code == 0, ended.said[-2000:]
        self.result, self.seconds = self.held(), ended.seconds

    def killed(self, after_s: float) -> tuple[bool, list[str]]:
        """Whether it still ran then, and what is wrong afterwards."""
        self.clear()
        since = time.monotonic()
        process = start(self.command, self.inputs, self.folder, self.log)
        while (
            time.monotonic() - since < after_s
            and os.waitid(os.P_PID, process, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None
        ):
            time.sleep(0.002)
        os.kill(process, signal.SIGKILL)
        ended = wait(process, self.log, since)
        found = self._orphans(process)
        again = run(self.command, self.inputs, self.folder, self.log)
        if wrong := wrong_with(again, refused=False):
            found.append(f"does not heal: {wrong}")
        elif different := differences(self.held(), self.result):
            found.append(f"heals to something else: {', '.join(different[:5])}")
        elif left := [name for name in unfinished(self.folder) if not name.startswith("tmp/")]:
            found.append(f"leaves {', '.join(left[:5])}")
        else:
            self.same += 1
        return ended.code == -signal.SIGKILL, found

    def _orphans(self, leader: int) -> list[str]:
        until = time.monotonic() + PATIENCE_S
        while (left := living(leader)) and time.monotonic() < until:
            time.sleep(0.05)
        names = [Path(f"/proc/{process}/cmdline").read_bytes().replace(b"\0", b" ").decode()[:120] for process in left]
        commands.kill_session(leader)
        return [f"what it had started runs on: {name}" for name in names]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.faults.kill", description=__doc__.split("\n", 1)[0])
    parser.add_argument("commands", nargs="*", metavar="COMMAND", help=", ".join(commands.BY_NAME))
    parser.add_argument("--moments", type=int, default=4, help="of each command")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--inputs", type=Path, help="folder for what the commands read, kept for the next time")
    parser.add_argument("--json", type=Path, help="file for the table")
    given = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory(prefix="aa4d-kill-") as folder:
        inputs = given.inputs or Path(folder, "inputs")
        wanted = commands.chosen(given.commands)
        in_own_process(lambda: commands.make_inputs(wanted, inputs))
        import_all()
        for command in wanted:
            bench = Bench(command, inputs, Path(folder, command.name))
            rows.append(try_command(bench, random.Random(f"{given.seed} {command.name}"), given.moments))
            shutil.rmtree(bench.folder, ignore_errors=True)
    if given.json is not None:
        write_json(given.json, {"rows": rows})
    sys.exit(1 if any(row["wrong"] for row in rows) else 0)


def try_command(bench: Bench, rng: random.Random, moments: int) -> dict[str, Any]:
    """Prints; returns a row of docs/hard-cases.md."""
    bench.undisturbed()
    count, still_ran = 0, 0
    for _ in range(moments):
        moment = rng.uniform(0, min(bench.seconds, LONGEST_S))
        ran, found = bench.killed(moment)
        still_ran += ran
        count += len(found)
        for what in found:
            print(f"    {bench.command.name}, killed after {moment:.2f} of {bench.seconds:.2f} s: {what}", flush=True)
    print(
        f"{bench.command.name:18} killed {still_ran} times ({moments - still_ran} too late), {count} wrong, "
        f"{bench.same} times the same {len(bench.result)} files",
        flush=True,
    )
    return {"command": bench.command.name, "killed": still_ran, "wrong": count}


if __name__ == "__main__":
    main()
