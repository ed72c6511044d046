"""A scene file becomes a capture, with Blender."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aa4d.blender import run_in_blender
from aa4d.errors import InputError, Interrupted
from aa4d.graph.call import Call
from aa4d.graph.kinds import Kind
from aa4d.graph.task import location

FRAME = re.compile(r"frame (\d+)/(\d+)")


@dataclass(frozen=True)
class Rendering:
    scene: str  # digest of the scene file and of what it names
    path: Path = location()


def run(call: Call) -> dict[str, Any]:
    """Raises InputError with the last line that the renderer printed, where it refuses."""
    settings: Rendering = call.task.settings
    last = ""

    def hear(line: str) -> None:
        nonlocal last
        if (frame := FRAME.match(line)) is not None:
            call.advance(int(frame[1]), int(frame[2]))
        last = line or last

    code = run_in_blender("synth/render_flyover.py", str(settings.path), "--out", str(call.folder), hear=hear)
    if code == 130:
        raise Interrupted(last)
    if code != 0:
        raise InputError(last or f"{settings.path}: rendering ended with exit code {code}")
    return {}


KIND = Kind(run)
