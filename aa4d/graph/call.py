"""What a task's function is given."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aa4d.graph.events import Advanced, Said, Tell
from aa4d.graph.task import Task


@dataclass(frozen=True)
class Need:
    """A task whose result is there."""

    task: Task
    folder: Path
    result: dict[str, Any]
    seconds: float | None  # of work; None where nobody knows


@dataclass(frozen=True)
class Call:
    task: Task
    folder: Path  # to fill
    needs: tuple[Need, ...]  # of a partial task, those that came to something
    failures: Mapping[str, str]  # of a partial task, sentences by the names of the others
    tell: Tell

    def advance(self, done: float, total: float, **facts: float) -> None:
        self.tell(Advanced(self.task, done, total, facts))

    def say(self, text: str) -> None:
        self.tell(Said(self.task, text))


def use_threads(threads: int | None) -> None:
    """Let this process compute with so many; None leaves the choice to torch."""
    if threads is not None:
        os.environ["OMP_NUM_THREADS"] = str(threads)  # read when torch is imported
        if "torch" in sys.modules:
            sys.modules["torch"].set_num_threads(threads)
