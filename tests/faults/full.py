"""`python -m tests.faults.full`: each command on a disk that is full at each of its writes, and where it may not write.

Every kind of file that a command writes, by whatever library or program, is cut short once: at its last page there is
no room left. Files that only a number or a random part of their names tells apart are one kind, of which the first is
cut. (That needs root; without, sizes of the disk are spread over what the command writes.) And there may be too few
files left to create one. Then the command says so in one sentence with exit code 2, leaves no file half-written and
what was there before as it was; once there is room, the same command comes to the same result as without the fault.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aa4d.files import write_json
from tests.faults import commands
from tests.faults.commands import Command, Ended, prepare, run, run_watched, wrong_with
from tests.faults.disk import MANY, PAGE, ROOMY, NoDisk, SmallDisk, enter_own_mounts
from tests.faults.tree import contents, differences, unfinished
from tests.faults.watch import NoWatch


@dataclass(frozen=True)
class Undisturbed:
    """What a command comes to without a fault."""

    before: dict[str, Any]
    result: dict[str, Any]
    begins_with: tuple[int, int]  # bytes and files in use before it
    ends_with: tuple[int, int]
    sizes: dict[str, int] | None  # bytes of the first file of each kind, in the order of creation; None: cannot be told


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
        # A disk holds a page at least: this one, so that there may be room for none.
        (self.disk.folder / "tmp" / "page").write_bytes(bytes(PAGE))

    def held(self) -> dict[str, Any]:
        found = contents(self.disk.folder)
        return {name: value for name, value in found.items() if not name.startswith("tmp/")}

    def run(self) -> Ended:
        return run(self.command, self.inputs, self.disk.folder, self.log)

    def undisturbed(self) -> Undisturbed:
        self.clear()
        begins, before = (self.disk.used(), self.disk.files()), self.held()
        kinds: dict[int, str] = {}
        sizes: dict[str, int] = {}

        def opening(kind: str, file: os.stat_result) -> None:
            if not file.st_size and kind not in sizes:
                kinds[file.st_ino], sizes[kind] = kind, 0

        def written(_kind: str, file: os.stat_result) -> None:
            if file.st_ino in kinds:
                sizes[kinds[file.st_ino]] = file.st_size

        is_heard = True
        try:
            ended = run_watched(self.command, self.inputs, self.disk.folder, self.log, opening, written)
        except NoWatch as reason:
            print(f"    {self.command.name}: {reason}; sizes of the disk are tried instead")
            ended, is_heard = self.run(), False
        assert ended.code == 0, ended.said[-2000:]
        ends = self.disk.used(), self.disk.files()
        return Undisturbed(before, self.held(), begins, ends, sizes if is_heard else None)

    def cut(self, whole: Undisturbed) -> Iterator[tuple[str, list[str]]]:
        """What is wrong where each kind of file is cut short, in one try after the other.

        Each goes on with what the last left, until the command succeeds all the same.
        """
        self.clear()
        is_fresh = True
        for kind, size in (whole.sizes or {}).items():
            if not size:
                continue
            ended, is_cut = self.cut_once(kind, size)
            if not is_cut and not is_fresh:
                self.clear()  # what was left needed no such file
                ended, is_cut = self.cut_once(kind, size)
            is_fresh = wrong_with(ended, refused=False) is None
            if not is_fresh:
                yield kind, self._left(ended, whole)
                continue
            print(f"    {self.command.name}, {kind}: {'does without it' if is_cut else 'not written'}", flush=True)
            if lost := differences(self.held(), whole.result):
                yield kind, [f"success, but not all is there: {', '.join(lost[:5])}"]
            self.clear()

    def cut_once(self, kind: str, size: int) -> tuple[Ended, bool]:
        """Run on a disk that is full at the last page of the first file of that kind; whether there was one."""
        is_cut = False

        def opening(opened: str, file: os.stat_result) -> None:
            nonlocal is_cut
            if opened == kind and not file.st_size and not is_cut:
                is_cut = True
                self.disk.hold_more((size - 1) // PAGE * PAGE)

        try:
            ended = run_watched(self.command, self.inputs, self.disk.folder, self.log, opening, lambda *_: None)
        finally:
            self.disk.hold()
        return ended, is_cut

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
        found = self._left(ended, whole)
        self.disk.hold()
        return found + self.healed(whole)

    def _left(self, ended: Ended, whole: Undisturbed) -> list[str]:
        found = [what for what in [wrong_with(ended, refused=True)] if what]
        if left := [name for name in unfinished(self.disk.folder) if not name.startswith("tmp/")]:
            found.append(f"half-written: {', '.join(left[:5])}")
        now = self.held()
        if lost := [name for name, value in whole.before.items() if now.get(name) not in (value, whole.result[name])]:
            found.append(f"lost of what was there before: {', '.join(lost[:5])}")
        return found

    def healed(self, whole: Undisturbed) -> list[str]:
        again = self.run()
        if wrong := wrong_with(again, refused=False):
            return [f"does not heal: {wrong}"]
        different = differences(self.held(), whole.result)
        return [f"heals to something else: {', '.join(different[:5])}"] if different else []

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
    """Sizes of the disk, in files, at which to try: spread over what the command adds, ends included.

    In bytes too, where its files cannot be cut one by one.
    """
    (begin, first), (end, last) = whole.begins_with, whole.ends_with

    def spread(low: int, high: int, count: int) -> list[int]:
        count = min(count, high - low)
        return sorted({low + round(i * (high - low - 1) / max(count - 1, 1)) for i in range(count)})

    pages = spread(max(begin // PAGE, 1), -(-end // PAGE), most) if whole.sizes is None else []
    files = spread(first, last, most)
    return [(page * PAGE, MANY) for page in pages] + [(ROOMY, count) for count in files]


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
    name, begin = bench.command.name, time.monotonic()
    whole = bench.undisturbed()
    attempts = {"read-only": bench.read_only, "forbidden": bench.forbidden}
    tried = {label: show(name, label, attempt(whole)) for label, attempt in attempts.items()}
    for size, files in places(whole, most):
        label = f"{size >> 10} KiB" if files == MANY else f"{files} files"
        tried[label] = show(name, label, bench.faults(whole, size, files))
    cut = {kind: show(name, kind, found) for kind, found in bench.cut(whole)}
    healed = show(name, "after the last", bench.healed(whole))
    wrong, seconds = sum(map(len, [*tried.values(), *cut.values(), healed])), time.monotonic() - begin
    count = len(tried) + len(cut)
    print(
        f"{name:18} {count:3} faults tried, {wrong} wrong, {len(cut)} kinds of files cut, {seconds:.0f} s", flush=True
    )
    return {"command": name, "tried": len(tried), "cut": len(cut), "wrong": wrong}


def show(command: str, label: str, found: list[str]) -> list[str]:
    for what in found:
        print(f"    {command}, {label}: {what}", flush=True)
    return found


def in_own_process(work: Any) -> None:
    """So that no thread stays here: what is forked from a process with threads may hang."""
    process = os.fork()
    if process == 0:
        code = 1
        try:
            work()
            code = 0
        except BaseException:
            traceback.print_exc()
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
