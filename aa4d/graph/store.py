"""The folder in which results lie, each beside a record of what it was made from, what it holds and how long it took.

Where nothing else is said a result lies in `KIND/NAME-DIGEST/` and its record in `KIND/NAME-DIGEST.json`; the digest
alone tells what it is, so that results may be renamed, or moved to another such folder. One that is being made lies in
`KIND/NAME-DIGEST.part/`, which is renamed when it is whole.

The result of a task with `outputs` is these files and folders of the store's folder itself. They are made where they
lie, by a function that writes each of them whole and continues what is there; the record is `.made/NAME.json`.
"""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from filelock import FileLock

from aa4d.errors import InputError
from aa4d.files import make_folder, read_json_object, write_json
from aa4d.graph.kinds import Kept, kind_of
from aa4d.graph.task import Task
from aa4d.identity import digest_of, digest_of_file

SHORT = 12  # digits of a digest in the name of a folder
LOCKS = ".locks"
MADE = ".made"

Contents = Mapping[str, str]  # what the results of needs hold, by the digests of their tasks


@dataclass(frozen=True)
class Store:
    root: Path

    def folder(self, task: Task) -> Path:
        """Where a task's result lies or is to lie."""
        if task.outputs:
            return self.root
        if task.place is not None:
            return self.root / task.place
        ending = f"-{task.digest[:SHORT]}"
        usual = self.root / task.kind / (re.sub(r"[^A-Za-z0-9.+_-]+", "-", task.name).strip("-.")[:80] + ending)
        if usual.with_name(f"{usual.name}.json").exists():
            return usual
        found = min((self.root / task.kind).glob(f"*{ending}.json"), default=None)  # made under another name
        return usual if found is None else found.with_suffix("")

    def record_path(self, task: Task, ending: str = ".json") -> Path:
        """Of the record of a task's result, or of what is remembered of an interrupted try."""
        folder = self.root / MADE / task.name if task.outputs else self.folder(task)
        return folder.with_name(folder.name + ending)

    def kept(self, task: Task, contents: Contents) -> Kept | None:
        """The result of a task, as it was made from needs that hold `contents`; None where it is to be made.

        Raises:
            InputError: the task's own place holds something that must not be overwritten.
        """
        kind, folder = kind_of(task.kind), self.folder(task)
        if kind.kept is not None:
            return kind.kept(task, folder)
        record = _record(self.record_path(task))
        if record is None or record["identity"] != task.identity.as_json() or record["made_from"] != contents:
            return None
        files = record["files"]
        if not all(_is_as_made(folder / name, *entry) for name, entry in files.items()):
            return None
        return Kept(record["result"], record["seconds"], _content(files, record["result"]))

    def edited(self, task: Task) -> Path | None:
        """What of a task's result is not as it was made; None where it was never made, or is as it was made."""
        folder = self.folder(task)
        path = self.record_path(task)
        if (_read(path) or {}).get("identity") != task.identity.as_json():
            return None
        record = _record(path)
        if record is None:
            return path
        wrong = (folder / name for name, entry in record["files"].items() if not _is_as_made(folder / name, *entry))
        return next(wrong, None)

    @contextmanager
    def making(self, task: Task) -> Iterator[Path]:
        """The folder to make a result in, with what an interrupted try has left; nobody else makes it meanwhile."""
        make_folder(self.root / LOCKS)
        with FileLock(self.root / LOCKS / task.digest[:SHORT]):
            if kind_of(task.kind).kept is not None or task.outputs:
                yield self.folder(task)
                return
            part = self.record_path(task, ".part")
            if task.place is not None:  # its name does not tell of which task it is the rest
                shutil.rmtree(part, ignore_errors=True)
            make_folder(part)
            yield part

    def spent(self, task: Task) -> float:
        """Seconds of interrupted tries."""
        told = _read(self.record_path(task, ".part.json")) or {}
        seconds = told.get("seconds") if told.get("task") == task.digest else None
        return seconds if isinstance(seconds, float) and 0 <= seconds < math.inf else 0.0

    def interrupted(self, task: Task, seconds: float) -> None:
        """Remember how long the tries took, for the seconds of the result."""
        if kind_of(task.kind).kept is None:
            with suppress(OSError, InputError):  # a full disk
                path = self.record_path(task, ".part.json")
                make_folder(path.parent)
                write_json(path, {"task": task.digest, "seconds": seconds})

    def keep(self, task: Task, contents: Contents, result: dict[str, Any], seconds: float) -> Kept:
        """Rename what `making` gave, now whole, and write its record.

        Raises:
            InputError: the result is not there.
        """
        kind, folder = kind_of(task.kind), self.folder(task)
        if kind.kept is not None:
            kept = kind.kept(task, folder)
            if kept is None:
                raise InputError(f"{folder}: {task.title} has left no result there; run the same command again")
            return kept
        part = folder if task.outputs else self.record_path(task, ".part")
        lacking = next((name for name in task.outputs if not (part / name).exists()), None)
        if lacking is not None:
            raise InputError(f"{part / lacking}: {task.title} has not made it; run the same command again")
        found = (path for name in task.outputs or (".",) for path in (part / name, *sorted((part / name).rglob("*"))))
        files = {path.relative_to(part).as_posix(): _entry(path) for path in found if path.is_file()}
        before = _record(self.record_path(task))
        if task.outputs and before is not None and before["files"] == files:  # looked at, and left as it was
            seconds = before["seconds"]
        record: dict[str, Any] = {
            "identity": task.identity.as_json(),
            "name": task.name,
            "made_from": dict(contents),
            "result": result,
            "seconds": round(seconds, 3),
            "units": task.units,
            "alike": task.alike,
            "files": files,
        }
        # In this order: killed in between, the next try finds all in the unfinished folder, and has little to do.
        path = self.record_path(task)
        make_folder(path.parent)
        write_json(path, record | {"sum": digest_of(record)})
        if not task.outputs:
            shutil.rmtree(folder, ignore_errors=True)
            part.replace(folder)
        self.record_path(task, ".part.json").unlink(missing_ok=True)
        return Kept(result, record["seconds"], _content(files, result))

    def records(self) -> Iterator[dict[str, Any]]:
        """Those of all results that are there."""
        for path in sorted(self.root.glob("*/*.json")) + sorted(self.root.glob("*.json")):
            if (record := _record(path)) is not None:
                yield record


def _record(path: Path) -> dict[str, Any] | None:
    """None where there is none, or somebody has changed it."""
    record = _read(path)
    try:
        return None if record is None or record.pop("sum", None) != digest_of(record) else record
    except ValueError:  # a number that is none
        return None


def _read(path: Path) -> dict[str, Any] | None:
    """A damaged record costs no more than the task's time."""
    try:
        return read_json_object(path, "the record of a task")
    except InputError:
        return None


def _entry(path: Path) -> list[Any]:
    """SHA-256, bytes, and when it was last written: a file that has the last two as before is not read again."""
    facts = path.stat()
    return [digest_of_file(path), facts.st_size, facts.st_mtime_ns]


def _is_as_made(path: Path, digest: str, size: int, written: int) -> bool:
    try:
        facts = path.stat()
        if facts.st_size != size:
            return False
        return facts.st_mtime_ns == written or digest_of_file(path) == digest
    except OSError:
        return False


def _content(files: dict[str, list[Any]], result: dict[str, Any]) -> str:
    return digest_of({"files": {name: entry[0] for name, entry in files.items()}, "result": result})
