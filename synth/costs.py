"""cost.json: seconds of every stage and of every frame, added up over interrupted runs."""

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from synth.files import write_json


class Costs:
    """A stopwatch per stage. `frames` maps a frame's name to its seconds per stage."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.stages: dict[str, float] = {}
        self.frames: dict[str, dict[str, float]] = {}
        if path.is_file():
            before = json.loads(path.read_text(encoding="utf-8"))
            self.stages = dict(before["stages"])
            self.frames = {frame.pop("name"): frame for frame in before["frames"]}

    @contextmanager
    def stage(self, name: str, frame: str | None = None) -> Iterator[None]:
        """Time what runs inside; with a frame's name also under that frame."""
        start = time.perf_counter()
        yield
        seconds = time.perf_counter() - start
        self.stages[name] = round(self.stages.get(name, 0.0) + seconds, 4)
        if frame is not None:
            self.frames.setdefault(frame, {})[name] = round(seconds, 4)

    def save(self) -> None:
        write_json(self.path, self.document())

    def document(self) -> dict[str, Any]:
        """The file's content; all numbers are seconds."""
        frames = [{"name": name, **self.frames[name]} for name in sorted(self.frames)]
        return {"seconds": round(sum(self.stages.values()), 3), "stages": self.stages, "frames": frames}
