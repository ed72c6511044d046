"""Steps that are run once: each keeps its result in a folder of its own, under a digest of all that it depends on.

A step's digest covers its settings and the digest of the step before, so that a changed setting repeats that step and
those after it, and nothing else. So does a step of which a file is missing or has another size than it was given. A
step works in `NAME.part` and is renamed when it is done; one that was stopped finds there what it has made, if it was
stopped under the same digest.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Generic, Self, TypeVar

from aa4d.errors import InputError
from aa4d.files import FULL, write_json

# Called by a step for whoever watches: units done, units in all (None while unknown).
Progress = Callable[[int, int | None], None]


class DiskFullError(InputError):
    """The one refusal after which the same command can go on."""


@dataclass(frozen=True)
class StepResult:
    """Base of the results of steps: its files, and fields that later steps and the report need, kept as JSON."""

    folder: Path

    def as_json(self) -> dict[str, Any]:
        value = asdict(self)
        del value["folder"]
        return value

    @classmethod
    def from_json(cls, folder: Path, value: dict[str, Any]) -> Self:
        """Raises KeyError or TypeError for a record that another version has written."""
        kept = {f.name: value[f.name] for f in fields(cls) if f.name != "folder"}
        return cls(folder, **{name: tuple(v) if isinstance(v, list) else v for name, v in kept.items()})

    def is_whole(self) -> bool:
        """Whether the files are such that later steps can read them; their sizes are those that they had."""
        return True


R = TypeVar("R", bound=StepResult)


@dataclass(frozen=True)
class Step(Generic[R]):
    name: str  # name of its folder
    settings: Any  # all that the result depends on, besides the steps before: anything that JSON holds
    run: Callable[[Path, Progress], R]  # makes the step's files in the folder
    result: type[R]


class Workspace:
    """The steps' folders, in the order in which `run` is called."""

    def __init__(self, folder: Path, watch: Callable[[str, bool], Progress]) -> None:
        """
        Args:
            watch: called with a step's name and whether it was done before; returns the step's progress.
        """
        self.folder = folder
        self.seconds: dict[str, float] = {}
        self._watch = watch
        self._digest = ""
        self._valid = True  # until a step is repeated: whatever stands after it is stale

    def run(self, step: Step[R]) -> R:
        """The result of a step, made now or before.

        Raises:
            DiskFullError: what was made is kept; whatever the step's `run` raises.
        """
        name = step.name
        text = json.dumps([name, step.settings, self._digest], sort_keys=True, default=str)
        self._digest = hashlib.sha256(text.encode()).hexdigest()[:16]
        folder, part = self.folder / name, self.folder / f"{name}.part"
        record = self._record(folder) if self._valid else None
        kept = None if record is None else _result(step.result, folder, record)
        if record is not None and kept is not None:
            self._watch(name, True)
            self.seconds[name] = record["seconds"]
            return kept
        self._valid = False
        progress = self._watch(name, False)
        shutil.rmtree(folder, ignore_errors=True)
        stopped = self._prepare(part)
        started = time.perf_counter()
        try:
            result = step.run(part, progress).as_json()
        except OSError as error:
            if error.errno in FULL:
                raise DiskFullError(
                    f"{part}: no space is left on the disk ({error.strerror}); free some, or ask for fewer or smaller "
                    "frames (--max-frames, --size), and run the same command again"
                ) from None
            raise
        finally:
            spent = stopped + time.perf_counter() - started
            if part.is_dir():
                _try_write(part / "stopped.json", {"digest": self._digest, "seconds": spent})
        (part / "stopped.json").unlink(missing_ok=True)
        done = {"digest": self._digest, "seconds": spent, "result": result, "sizes": _sizes(part)}
        write_json(part / "done.json", done)
        part.replace(folder)
        self.seconds[name] = spent
        return step.result.from_json(folder, result)

    def earlier(self, name: str, kind: type[R]) -> R | None:
        """The result of that step when it was last done, under whatever settings."""
        record = _read(self.folder / name / "done.json")
        return None if record is None else _result(kind, self.folder / name, record)

    def forget(self, name: str) -> None:
        """Make that step anew when it is run next."""
        (self.folder / name / "done.json").unlink(missing_ok=True)

    def _record(self, folder: Path) -> dict[str, Any] | None:
        record = _read(folder / "done.json")
        if record is None or record.get("digest") != self._digest:
            return None
        return record if record.get("sizes", {}).items() <= _sizes(folder).items() else None

    def _prepare(self, part: Path) -> float:
        """Keep what a stopped run of this very step has made; returns the seconds that it took."""
        stopped = _read(part / "stopped.json")
        if stopped and stopped.get("digest") == self._digest:
            return float(stopped["seconds"])
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
        # Written first: a step that is killed outright is known again too.
        _try_write(part / "stopped.json", {"digest": self._digest, "seconds": 0.0})
        return 0.0


def _result(kind: type[R], folder: Path, record: dict[str, Any]) -> R | None:
    """None where the record has not the fields of this version, or its files are not whole."""
    try:
        result = kind.from_json(folder, record["result"])
        return result if result.is_whole() else None
    except (KeyError, TypeError, AttributeError):
        return None


def _sizes(folder: Path) -> dict[str, int]:
    """Bytes of every file in `folder`."""
    return {p.relative_to(folder).as_posix(): p.stat().st_size for p in sorted(folder.rglob("*")) if p.is_file()}


def _read(path: Path) -> dict[str, Any] | None:
    """A damaged record costs no more than the step's time."""
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return value if isinstance(value, dict) else None


def _try_write(path: Path, value: dict[str, Any]) -> None:
    try:
        write_json(path, value)
    except OSError:  # the disk is full, and the step says so itself
        path.unlink(missing_ok=True)
