"""The folder in which results lie, each beside a record of what it was made from, what it holds and how long it took.

Where nothing else is said a result lies in `KIND/NAME-DIGEST/` and its record in `KIND/NAME-DIGEST.json`; the digest
alone tells what it is, so that results may be renamed, or moved to another such folder. One that is being made lies in
`KIND/NAME-DIGEST.part/`, which is renamed when it is whole.
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

Contents = Mapping[str, str]  # what the results of needs hold, by the digests of their tasks


@dataclass(frozen=True)
class Store:
    root: Path

    def folder(self, task: Task) -> Path:
        """Where a task's result lies or is to lie."""
        if task.place is not None:
            return self.root / task.place
        ending = f"-{task.digest[:SHORT]}"
        found = next(iter(sorted((self.root / task.kind).glob(f"*{ending}.json"))), None)
        if found is not None:
            return found.with_suffix("")
        return self.root / task.kind / (re.sub(r"[^A-Za-z0-9.+_-]+", "-", task.name).strip("-.")[:80] + ending)

    def kept(self, task: Task, contents: Contents) -> Kept | None:
        """The result of a task, as it was made from needs that hold `contents`; None where it is to be made.

        Raises:
            InputError: the task's own place holds something that must not be overwritten.
        """
        kind, folder = kind_of(task.kind), self.folder(task)
        if kind.kept is not None:
            return kind.kept(task, folder)
        record = _record(_beside(folder, ".json"))
        if record is None or record["identity"] != task.identity.as_json() or record["made_from"] != contents:
            return None
        files = record["files"]
        if not all(_is_as_made(folder / name, *entry) for name, entry in files.items()):
            return None
        return Kept(record["result"], record["seconds"], _content(files, record["result"]))

    def edited(self, task: Task) -> Path | None:
        """What of a task's result is not as it was made; None where it was never made, or is as it was made."""
        folder = self.folder(task)
        path = _beside(folder, ".json")
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
            if kind_of(task.kind).kept is not None:
                yield self.folder(task)
                return
            part = _beside(self.folder(task), ".part")
            if task.place is not None:  # its name does not tell of which task it is the rest
                shutil.rmtree(part, ignore_errors=True)
            make_folder(part)
            yield part

    def spent(self, task: Task) -> float:
        """Seconds of interrupted tries."""
        seconds = (_read(_beside(self.folder(task), ".part.json")) or {}).get("seconds")
        return seconds if isinstance(seconds, float) and 0 <= seconds < math.inf else 0.0

    def interrupted(self, task: Task, seconds: float) -> None:
        """Remember how long the tries took, for the seconds of the result."""
        if kind_of(task.kind).kept is None:
            with suppress(OSError):  # a full disk
                write_json(_beside(self.folder(task), ".part.json"), {"seconds": seconds})

    def keep(self, task: Task, contents: Contents, result: dict[str, Any], seconds: float) -> Kept:
        """Rename what `making` gave, now whole, and write its record."""
        kind, folder = kind_of(task.kind), self.folder(task)
        if kind.kept is not None:
            kept = kind.kept(task, folder)
            if kept is None:
                raise InputError(f"{folder}: {task.title} has left no result there; run the same command again")
            return kept
        part = _beside(folder, ".part")
        files = {path.relative_to(part).as_posix(): _entry(path) for path in sorted(part.rglob("*")) if path.is_file()}
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
        write_json(_beside(folder, ".json"), record | {"sum": digest_of(record)})
        shutil.rmtree(folder, ignore_errors=True)
        part.replace(folder)
        _beside(folder, ".part.json").unlink(missing_ok=True)
        return Kept(result, record["seconds"], _content(files, result))

    def records(self) -> Iterator[dict[str, Any]]:
        """Those of all results that are there."""
        for path in sorted(self.root.glob("*/*.json")) + sorted(self.root.glob("*.json")):
            if (record := _record(path)) is not None:
                yield record


def _beside(folder: Path, ending: str) -> Path:
    return folder.with_name(folder.name + ending)


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
