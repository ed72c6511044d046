"""The events of a graph for those who look later: as lines of a file, and as curves of TensorBoard."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aa4d.graph.events import Advanced, Event, Failed, Finished, Said, Tell

if TYPE_CHECKING:
    from torch.utils.tensorboard import SummaryWriter

LOG = "events.jsonl"
ADVANCES_EVERY_S = 5.0  # of one task


def together(*listeners: Tell) -> Tell:
    """One that passes every event on to all of them, in this order."""

    def tell(event: Event) -> None:
        for listener in listeners:
            listener(event)

    return tell


def line_of(event: Event, at_s: float) -> dict[str, Any]:
    """A JSON object: seconds since 1970, what happened, to which task, and what the event holds."""
    line: dict[str, Any] = {"at_s": round(at_s, 3), "event": type(event).__name__.lower(), "task": event.task.title}
    if isinstance(event, Advanced):
        line |= {"done": event.done, "total": event.total, **event.facts}
    elif isinstance(event, Said):
        line["text"] = event.text
    elif isinstance(event, Finished):
        line["seconds"] = event.kept.seconds
    elif isinstance(event, Failed):
        line["sentence"] = event.sentence
    return line


class EventLog:
    """Appends lines to a file, all of what happens, and of a task's advances one now and then. A disk that is full
    stops the log, and nothing else."""

    def __init__(self, path: Path, clock: Callable[[], float] = time.time) -> None:
        self._path, self._clock = path, clock
        self._advanced: dict[str, float] = {}  # when that was last written, by the digests of tasks

    def __call__(self, event: Event) -> None:
        now, digest = self._clock(), event.task.digest
        if isinstance(event, Finished) and event.before:
            return
        if isinstance(event, Advanced):
            if event.done < event.total and now - self._advanced.get(digest, -ADVANCES_EVERY_S) < ADVANCES_EVERY_S:
                return
            self._advanced[digest] = now
        with suppress(OSError), self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line_of(event, now)) + "\n")


class Curves:
    """The facts of advancing tasks as scalars of TensorBoard, a run for each task."""

    def __init__(self, folder: Path, open_board: Callable[[Path, int], SummaryWriter]) -> None:
        """
        Args:
            open_board: of a folder and the steps that were done before; training's own.
        """
        self._folder, self._open = folder, open_board
        self._boards: dict[str, SummaryWriter] = {}

    def __call__(self, event: Event) -> None:
        if isinstance(event, Advanced) and event.facts:
            digest = event.task.digest
            if digest not in self._boards:
                self._boards[digest] = self._open(self._folder / event.task.name.replace("/", "-"), int(event.done) - 1)
            for name, value in event.facts.items():
                self._boards[digest].add_scalar(f"{event.task.kind}/{name}", value, int(event.done))
        elif (
            not isinstance(event, Said | Advanced) and (board := self._boards.pop(event.task.digest, None)) is not None
        ):
            board.close()
