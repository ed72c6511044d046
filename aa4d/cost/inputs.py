"""Inputs that panels share: a capture, smaller versions of it, and trainings on them. Each is a task, and made once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from aa4d.blender import blender_is_here, script
from aa4d.capture.reader import read_capture
from aa4d.cost.kind import cost_task
from aa4d.cost.panel import Setup
from aa4d.experiments.kinds.evaluate import Evaluation
from aa4d.experiments.kinds.render import Rendering
from aa4d.experiments.kinds.train import Training, iterations_of
from aa4d.graph.task import Task
from aa4d.methods.settings import RunSettings

NO_BLENDER = "Blender is not here: put `blender` on PATH, or install the module with pip install -e '.[blender]'"


@dataclass(frozen=True)
class Source:
    """A capture that is there, or the task that makes it."""

    identity: str | None
    path: Path | None
    needs: tuple[Task, ...]


def no_blender(_setup: Setup) -> str | None:
    return None if blender_is_here() else NO_BLENDER


def no_capture(setup: Setup) -> str | None:
    if setup.capture is not None or blender_is_here():
        return None
    return f"{NO_BLENDER}; or name a capture with --capture"


def source_of(setup: Setup) -> Source:
    """Raises InputError where the capture cannot be read."""
    if setup.capture is not None:
        return Source(read_capture(setup.capture).identity.digest(), setup.capture.resolve(), ())
    scene = script(setup.size.scene)
    rendering = Rendering.of(scene, {}, scene.stem)
    return Source(None, None, (Task("render", setup.size.name, rendering, alike=scene.stem),))


def scaled(setup: Setup, share: float) -> Source:
    """The capture with frames of `share` times the width and height."""
    whole = source_of(setup)
    if share == 1:
        return whole
    paths = {} if whole.path is None else {"capture": whole.path}
    given = {"share": share, "capture": whole.identity}
    task = cost_task("aa4d.cost.scaled", f"frames at {share:g} times", given, whole.needs, seconds=3, paths=paths)
    return Source(None, None, (task,))


def trained(setup: Setup, name: str, settings: RunSettings, source: Source) -> Task:
    return Task(
        "train",
        name,
        Training.of(settings, source.identity, source.path),
        source.needs,
        units=iterations_of(settings),
        alike=f"{settings.method} {setup.size.name}",
    )


def scored(setup: Setup, name: str, settings: RunSettings) -> Task:
    """The evaluation of a training at the size's usual share."""
    source = scaled(setup, setup.size.share)
    training = trained(setup, name, settings, source)
    alike = f"{settings.method} {setup.size.name}"
    return Task("evaluate", name, Evaluation(source.path), (training, *source.needs), alike=alike)
