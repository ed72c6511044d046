"""`python -m tests.faults.full`: each command on a disk that is full at each of its writes, and where it may not write.

Every file that a command makes is a place at which the disk is full: of bytes in the middle of it and at its end, and
of files at its creation. Then the command says so in one sentence with exit code 2, leaves no file half-written and
what was there before as it was; once there is room, the same command comes to the same result as without the fault.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aa4d.files import write_json
from tests.faults import commands
from tests.faults.commands import Command, Ended, prepare, run, wrong_with
from tests.faults.disk import MANY, ROOMY, NoDisk, SmallDisk, enter_own_mounts
from tests.faults.tree import contents, differences, unfinished


@dataclass(frozen=True)
class Undisturbed:
    """What a command comes to without a fault."""

    before: dict[str, Any]
    result: dict[str, Any]
    begins_with: tuple[int, int]  # bytes and files in use before it
    ends_with: tuple[int, int]


class Bench:
    """One command, its disk, and what it did there."""

    def __init__(self, command: Command, inputs: Path, scratch: Path) -> None:
        self.command, self.inputs, self.log = command, inputs, scratch / "log"
        self.disk = SmallDisk(scratch / "disk")

    def clear(self) -> None:
        self.disk.hold()
        for entry in self.disk.folder.iterdir():
            shutil.rmtree(entry) if entry.is_dir() and not entry.is_symlink() else entry.unlink()
        prepare(self.command, self.inputs, self.disk.folder)

    def held(self) -> dict[str, Any]:
        found = contents(self.disk.folder)
        return {name: value for name, value in found.items() if not name.startswith("tmp/")}

    def run(self) -> Ended:
        return run(self.command, self.inputs, self.disk.folder, self.log)

    def undisturbed(self) -> Undisturbed:
        self.clear()
        begins, before = (self.disk.used(), self.disk.files()), self.held()
        ended = self.run()
        assert ended.code == 0, ended.said[-2000:]
        return Undisturbed(before, self.held(), begins, (self.disk.used(), self.disk.files()))

    def faults(self, whole: Undisturbed, size: int, files: int) -> list[str]:
        """What is wrong where the disk holds so many bytes and files."""
        self.clear()
        self.disk.hold(size, files)
        ended = self.run()
        if ended.code == 0 and not wrong_with(ended, refused=False):
            lost = differences(self.held(), whole.result)  # there was room enough after all
            return [f"success, but not all is there: {', '.join(lost[:5])}"] if lost else []
        return self._after(ended, whole)

    def _after(self, ended: Ended, whole: Undisturbed) -> list[str]:
        found = [wrong_with(ended, refused=True)]
        if left := [name for name in unfinished(self.disk.folder) if not name.startswith("tmp/")]:
            found.append(f"half-written: {', '.join(left[:5])}")
        now = self.held()
        if lost := [name for name, value in whole.before.items() if now.get(name) not in (value, whole.result[name])]:
            found.append(f"lost of what was there before: {', '.join(lost[:5])}")
        self.disk.hold()
        again = self.run()
        if wrong := wrong_with(again, refused=False):
            found.append(f"does not heal: {wrong}")
        elif different := differences(self.held(), whole.result):
            found.append(f"heals to something else: {', '.join(different[:5])}")
        return [what for what in found if what]

    def read_only(self, whole: Undisturbed) -> list[str]:
        """What is wrong where the file system is read-only."""
        self.clear()
        self.disk.protect(read_only=True)
        try:
            ended = self.run()
        finally:
            self.disk.protect(read_only=False)
        return self._after(ended, whole)

    def forbidden(self, whole: Undisturbed) -> list[str]:
        """What is wrong where nothing may be written but scratch files."""
        self.clear()
        tree = [self.disk.folder, *(p for p in self.disk.folder.rglob("*") if p.name != "tmp")]
        for path in tree:
            path.chmod(0o555 if path.is_dir() else 0o444)
        ended = run(self.command, self.inputs, self.disk.folder, self.log, unprivileged=True)
        for path in tree:
            path.chmod(0o755 if path.is_dir() else 0o644)
        return self._after(ended, whole)


def places(whole: Undisturbed, most: int) -> list[tuple[int, int]]:
    """Sizes of the disk, in bytes and in files, at which to try: spread over what the command adds, ends included."""
    (begin, first), (end, last) = whole.begins_with, whole.ends_with

    def spread(low: int, high: int, count: int) -> list[int]:
        count = min(count, high - low)
        return sorted({low + round(i * (high - low - 1) / max(count - 1, 1)) for i in range(count)})

    pages = spread(max(begin // 4096, 1), -(-end // 4096), most)
    files = spread(first, last, most)
    return [(page * 4096, MANY) for page in pages] + [(ROOMY, count) for count in files]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.faults.full", description=__doc__.split("\n", 1)[0])
    parser.add_argument("commands", nargs="*", metavar="COMMAND", help=", ".join(commands.BY_NAME))
    parser.add_argument("--places", type=int, default=12, help="at most so many of bytes and of files, each command")
    parser.add_argument("--inputs", type=Path, help="folder for what the commands read, kept for the next time")
    parser.add_argument("--json", type=Path, help="file for the table")
    given = parser.parse_args()
    try:
        enter_own_mounts()
    except NoDisk as reason:
        print(f"skipped: {reason}")
        return
    rows = []
    with tempfile.TemporaryDirectory(prefix="aa4d-faults-") as folder:
        inputs = given.inputs or Path(folder, "inputs")
        wanted = [command for command in commands.chosen(given.commands) if not command.only_killed]
        in_own_process(lambda: commands.make_inputs(wanted, inputs))
        import_all()
        for command in wanted:
            scratch = Path(folder, command.name)
            scratch.mkdir()
            bench = Bench(command, inputs, scratch)
            try:
                rows.append(try_command(bench, given.places))
            finally:
                bench.disk.remove()
    if given.json is not None:
        write_json(given.json, {"rows": rows})
    sys.exit(1 if any(row["wrong"] for row in rows) else 0)


def try_command(bench: Bench, most: int) -> dict[str, Any]:
    """Prints; returns a row of docs/hard-cases.md."""
    name, begin, count = bench.command.name, time.monotonic(), 0
    whole = bench.undisturbed()
    tried = places(whole, most)
    attempts: list[tuple[str, Any]] = [
        ("read-only", lambda: bench.read_only(whole)),
        ("forbidden", lambda: bench.forbidden(whole)),
    ]
    attempts += [
        (f"{size >> 10} KiB" if files == MANY else f"{files} files", lambda s=size, f=files: bench.faults(whole, s, f))
        for size, files in tried
    ]
    for label, attempt in attempts:
        for what in attempt():
            count += 1
            print(f"    {name}, {label}: {what}", flush=True)
    print(f"{name:18} {len(attempts):3} faults tried, {count} wrong, {time.monotonic() - begin:.0f} s", flush=True)
    return {"command": name, "tried": len(attempts), "wrong": count}


def in_own_process(work: Any) -> None:
    """So that no thread stays here: what is forked from a process with threads may hang."""
    process = os.fork()
    if process == 0:
        code = 1
        try:
            work()
            code = 0
        finally:
            os._exit(code)
    assert os.waitpid(process, 0)[1] == 0


def import_all() -> None:
    """What the commands import, once."""
    import aa4d.capture.make
    import aa4d.evaluation.evaluate
    import aa4d.experiments.command
    import aa4d.export.clip
    import aa4d.filming.film
    import aa4d.inspection.page
    import aa4d.training.trainer  # noqa: F401


if __name__ == "__main__":
    main()
