"""One reader, many damaged files: what it did that no reader may do."""

from __future__ import annotations

import random
import shutil
import signal
import tempfile
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from tests.fuzz.readers import Reader

LONGEST_S = 5.0  # of the processor, so that a busy machine is no defect
LONGEST_SENTENCE = 2000  # characters


class TooLong(BaseException):
    """Raised by the clock; no reader may catch it."""


@dataclass(frozen=True)
class Defect:
    """A file that a reader neither took nor refused in a sentence."""

    reader: str
    seed: int  # with which `damaged` makes it again
    what: str


def damaged(reader: Reader, good: bytes, seed: int) -> bytes:
    return reader.mutate(good, random.Random(f"{reader.name} {seed}"))


def attack(reader: Reader, seeds: range, before: Callable[[int], object] = lambda _: None) -> Iterator[Defect]:
    """Every defect that files of these seeds show; `before` hears each seed before its file is read."""
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as folder:
        reader.make(Path(folder))
        path = Path(folder) / reader.file
        good = path.read_bytes()
        reader.read(path)  # the good file is taken
        for seed in seeds:
            path.write_bytes(damaged(reader, good, seed))
            before(seed)
            what = verdict(reader, path)
            if what is not None:
                yield Defect(reader.name, seed, what)
            if not path.is_file():  # whatever the reader did to it
                shutil.rmtree(path, ignore_errors=True)


def verdict(reader: Reader, path: Path) -> str | None:
    """None where the file was taken, or refused in a sentence; else what happened."""
    try:
        with clock(LONGEST_S):
            try:
                found = reader.read(path)
            except reader.refuses as refusal:
                said = str(refusal)
                if "\n" in said:
                    return f"a refusal of several lines: {said!r:.300}"
                return None if len(said) <= LONGEST_SENTENCE else f"a refusal of {len(said)} characters: {said[:200]}"
            return None if reader.check(found) else "accepted, with values that no result could have"
    except TooLong:
        return f"longer than {LONGEST_S:g} s"
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__}: {str(error)[:200]} ({Path(where.filename).name}:{where.lineno})"


@contextmanager
def clock(seconds: float) -> Iterator[None]:
    def ring(_number: int, _frame: FrameType | None) -> None:
        raise TooLong

    before = signal.signal(signal.SIGPROF, ring)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
