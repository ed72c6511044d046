"""An experiment file becomes a graph: every scene is rendered, every variant trained and scored, and one table made."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from aa4d.capture.reader import read_capture
from aa4d.experiments.experiment_file import ExperimentFile, Source
from aa4d.experiments.kinds.evaluate import Evaluation
from aa4d.experiments.kinds.render import Rendering
from aa4d.experiments.kinds.tabulate import Entry, Tabulation
from aa4d.experiments.kinds.thin import Thinning
from aa4d.experiments.kinds.train import Training, iterations_of
from aa4d.graph.task import Task
from aa4d.methods.settings import RunSettings

TABLES = "tables"


@dataclass(frozen=True)
class Capture:
    """What runs of a scene begin with."""

    identity: str | None  # of a capture that is there
    path: Path | None
    needs: tuple[Task, ...]  # of one that is made first


def experiment_graph(file: ExperimentFile) -> Task:
    """The task of the tables, which needs all others, seed by seed: what is done so far compares like with like.

    Raises:
        InputError: a capture cannot be read.
    """
    captures = {source: _capture(source) for source in file.sources}
    entries, scores = [], []
    for seed in file.head.seeds:
        for scene, capture in captures.items():
            for variant, settings in file.variants.items():
                entries.append(Entry(scene.name, variant, seed, scene.at))
                name = f"{scene.name}, {variant}, seed {seed}"
                scores.append(_scores(name, scene.base, capture, settings, seed, file))
    tables = Tabulation(file.head.title, tuple(entries), file.knob)
    return Task("tabulate", file.path.stem, tables, tuple(scores), place=TABLES, partial=True)


def part_of(tables: Task, number: int, parts: int) -> tuple[Task, ...]:
    """Every `parts`-th evaluation, from the `number`-th on, which counts from 1."""
    return tables.needs[number - 1 :: parts]


def _capture(source: Source) -> Capture:
    if source.is_scene:
        rendering = Rendering.of(source.path, source.changes, source.rendered)
        whole = Capture(None, None, (Task("render", source.rendered, rendering, alike=source.base),))
    else:
        whole = Capture(read_capture(source.path).identity.digest(), source.path.resolve(), ())
    if source.keep_every == 1:
        return whole
    thinning = Thinning(source.keep_every, whole.identity, whole.path)
    return Capture(None, None, (Task("thin", source.name, thinning, whole.needs),))


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
