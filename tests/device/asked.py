"""What a check is asked to do, as each of its parts is told."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

# A part tells what it found as it goes, so that what was measured before its time was over is kept.
Keep = Callable[[str, Any], None]


@dataclass(frozen=True)
class Asked:
    """`device` is "cuda", or "cpu" for a rehearsal: native in CUDA's place, and the reference in that of native."""

    device: str
    work: str  # folder of what is built and trained
    capture: str | None = None
    model: str | None = None
    carried: str | None = None  # folder of source archives and wheels
    is_tiny: bool = False  # the smallest sizes that run every line
    ends: float = float("inf")  # seconds since the epoch, after which no further measurement begins

    @property
    def seconds_left(self) -> float:
        return self.ends - time.time()

    def as_text(self) -> str:
        return json.dumps(asdict(self))


def asked_of(text: str) -> Asked:
    return Asked(**json.loads(text))


def files_in(folder: str | None, pattern: str) -> list[Path]:
    return [] if folder is None else sorted(Path(folder).glob(pattern))


def attempt(call: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """What the call found, and how long it took; one that raises says so in its row and stops no other."""
    started = time.perf_counter()
    try:
        row = call()
    except Exception as error:
        row = {"raised": f"{type(error).__name__}: {(str(error).splitlines() or [''])[0]}"}
    return row | {"seconds": time.perf_counter() - started}
