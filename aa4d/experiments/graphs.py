"""An experiment file becomes a graph: every scene is rendered, every variant trained and scored, and one table made."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from aa4d.capture.reader import read_capture
from aa4d.experiments.experiment_file import ExperimentFile, Source
from aa4d.experiments.kinds.evaluate import Evaluation
from aa4d.experiments.kinds.render import Rendering
from aa4d.experiments.kinds.tabulate import Entry, Tabulation
from aa4d.experiments.kinds.train import Training, iterations_of
from aa4d.graph.task import Task
from aa4d.methods.settings import RunSettings
from aa4d.scene_files import scene_digest

TABLES = "tables"


@dataclass(frozen=True)
class Capture:
    """What runs of a scene begin with."""

    identity: str | None  # of a capture that is there
    path: Path | None
    needs: tuple[Task, ...]  # of one that is rendered first


def experiment_graph(file: ExperimentFile) -> Task:
    """The task of the tables, which needs all others, seed by seed: what is done so far compares like with like.

    Raises:
        InputError: a capture cannot be read.
    """
    captures = {source.name: _capture(source) for source in file.sources}
    entries, scores = [], []
    for seed in file.head.seeds:
        for scene, capture in captures.items():
            for variant, settings in file.variants.items():
                entries.append(Entry(scene, variant, seed))
                scores.append(_scores(f"{scene}, {variant}, seed {seed}", scene, capture, settings, seed, file))
    tables = Tabulation(file.head.title, tuple(entries))
    return Task("tabulate", file.path.stem, tables, tuple(scores), place=TABLES, partial=True)


def part_of(tables: Task, number: int, parts: int) -> tuple[Task, ...]:
    """Every `parts`-th evaluation, from the `number`-th on, which counts from 1."""
    return tables.needs[number - 1 :: parts]


def _capture(source: Source) -> Capture:
    if source.is_scene:
        rendering = Rendering(scene_digest(source.path), source.path.resolve())
        return Capture(None, None, (Task("render", source.name, rendering, alike=source.name),))
    capture = read_capture(source.path)
    return Capture(capture.identity.digest(), source.path.resolve(), ())


def _scores(name: str, scene: str, capture: Capture, settings: RunSettings, seed: int, file: ExperimentFile) -> Task:
    """The evaluation of a run."""
    settings = replace(settings, seed=seed)
    training = Task(
        "train",
        name,
        Training.of(settings, capture.identity, capture.path),
        capture.needs,
        file.head.resources,
        units=iterations_of(settings),
        alike=f"{settings.method} {scene}",
    )
    evaluation = Evaluation(capture.path)
    return Task("evaluate", name, evaluation, (training, *capture.needs), alike=f"{settings.method} {scene}")
