"""cost.json: seconds of every stage and of every frame, added up over interrupted runs."""

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from synth.errors import InputError
from synth.files import write_json


class Costs:
    """A stopwatch per stage. `frames` maps a frame's name to its seconds per stage. Without a path nothing is saved."""

    def __init__(self, path: Path | None) -> None:
        self.path = path
        self.stages: dict[str, float] = {}
        self.frames: dict[str, dict[str, float]] = {}
        self.effects: dict[str, float] = {}
        if path is not None and path.is_file():
            try:
                before = json.loads(path.read_text(encoding="utf-8"))
                self.stages, self.effects = dict(before["stages"]), dict(before["effects"])
                self.frames = {frame.pop("name"): frame for frame in before["frames"]}
            except (ValueError, TypeError, KeyError):  # a damaged file: what was spent is lost, nothing else
                self.stages, self.effects, self.frames = {}, {}, {}

    @contextmanager
    def stage(self, name: str, frame: str | None = None) -> Iterator[None]:
        """Time what runs inside; with a frame's name also under that frame."""
        start = time.perf_counter()
        try:
            yield
            if frame is not None:  # one that is interrupted is made again
                self.frames.setdefault(frame, {})[name] = round(time.perf_counter() - start, 4)
        finally:  # an interrupted stage has cost its seconds too
            self.stages[name] = round(self.stages.get(name, 0.0) + time.perf_counter() - start, 4)

    @contextmanager
    def effect(self, name: str) -> Iterator[None]:
        """Time what an effect does inside a stage."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.effects[name] = round(self.effects.get(name, 0.0) + time.perf_counter() - start, 4)

    def add(self, document: dict[str, Any]) -> None:
        """Take in what another process measured (its `document`)."""
        for mine, more in ((self.stages, document["stages"]), (self.effects, document["effects"])):
            for name, seconds in more.items():
                mine[name] = round(mine.get(name, 0.0) + seconds, 4)
        for frame in document["frames"]:
            self.frames.setdefault(frame["name"], {}).update({k: v for k, v in frame.items() if k != "name"})

    @contextmanager
    def saved(self) -> Iterator[None]:
        """Save what was measured inside, also when it is interrupted; what is refused writes nothing."""
        try:
            yield
        except InputError:
            raise
        except BaseException:
            self.save()
            raise
        self.save()

    def save(self) -> None:
        if self.path is not None:
            write_json(self.path, self.document())

    def document(self) -> dict[str, Any]:
        """The file's content; all numbers are seconds."""
        frames = [{"name": name, **self.frames[name]} for name in sorted(self.frames)]
        total = round(sum(self.stages.values()), 3)
        return {"seconds": total, "stages": self.stages, "effects": self.effects, "frames": frames}
