"""A scene file becomes a capture, with Blender."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from aa4d.blender import run_in_blender
from aa4d.errors import InputError
from aa4d.experiments.derived_scene import derived
from aa4d.files import write_text
from aa4d.graph.call import Call
from aa4d.graph.child import run_child
from aa4d.graph.kinds import Kind
from aa4d.graph.task import location
from aa4d.identity import digest_of
from aa4d.scene_files import files_named_in, scene_digest


@dataclass(frozen=True)
class Rendering:
    scene: str  # digest of the scene file, of what it names, and of the changes
    path: Path = location()
    changes: Mapping[str, Any] = location()  # of keys of the scene file; where there are some, under the name `name`
    name: str = location()

    @staticmethod
    def of(path: Path, changes: Mapping[str, Any], name: str) -> Rendering:
        """Raises InputError where there is no such scene file."""
        scene = scene_digest(path)
        return Rendering(digest_of([scene, changes, name]) if changes else scene, path.resolve(), changes, name)

    @property
    def described(self) -> str:
        return f"{self.path}, as {self.name}" if self.changes else str(self.path)

    @contextmanager
    def file(self) -> Iterator[Path]:
        """The scene file to render."""
        if not self.changes:
            yield self.path
            return
        with TemporaryDirectory(prefix="aa4d-scene-") as folder:
            path = Path(folder) / f"{self.name}.toml"
            for named in files_named_in(self.path):  # synth takes only what lies in a scene's folder or below it
                place = Path(folder) / os.path.relpath(named, self.path.parent)
                if place.resolve().is_relative_to(Path(folder).resolve()):  # else synth refuses it by its name
                    place.parent.mkdir(parents=True, exist_ok=True)
                    shutil.copyfile(named, place)
            write_text(path, derived(self.path, self.name, self.changes))
            yield path


def run(call: Call) -> dict[str, Any]:
    """Raises InputError with the last line that the renderer printed, where it refuses."""
    settings: Rendering = call.task.settings
    with settings.file() as scene:
        arguments = (str(scene), "--out", str(call.folder))
        try:
            run_child(
                call,
                lambda hear: run_in_blender("synth/render_flyover.py", *arguments, hear=hear),
                f"{scene}: rendering",
            )
        except InputError as error:  # a derived file is gone by the time that somebody reads this
            raise InputError(str(error).replace(str(scene), settings.described)) from None
    return {}


KIND = Kind(run)
