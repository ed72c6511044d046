"""The trials of an experiment as a graph: one task each, in a folder that is named after capture, variant and seed."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from aa4d.capture.content import check_content
from aa4d.capture.reader import Capture, read_capture
from aa4d.errors import InputError
from aa4d.experiments.kinds.evaluate import Row
from aa4d.experiments.kinds.train import iterations_of
from aa4d.experiments.kinds.trial import TrialRun
from aa4d.experiments.variants import Experiment
from aa4d.files import claimed, write_json
from aa4d.graph.engines import Engine
from aa4d.graph.events import Event, Failed, Finished, Tell
from aa4d.graph.scheduler import run_graph
from aa4d.graph.store import Store
from aa4d.graph.task import Task
from aa4d.methods.adaanchor4d.settings import AdaAnchor4DSettings
from aa4d.methods.settings import RunSettings
from aa4d.output_folder import claim_folder
from aa4d.training.run_folder import difference, what_counts
from aa4d.words import counted

INDEX = "experiment.json"


@dataclass(frozen=True)
class Trial:
    capture: Path
    label: str
    seed: int
    settings: RunSettings
    base: RunSettings  # without what the variant changes
    out: Path  # the run's folder

    @property
    def name(self) -> str:
        return f"{self.capture.name}, {self.label}, seed {self.seed}"


@dataclass(frozen=True)
class Outcome:
    """What the trials of an experiment came to, in the order of the trials."""

    rows: list[Row]
    failures: dict[str, str] = field(default_factory=dict)  # a sentence by the trial's name

    def checked(self) -> list[Row]:
        """The rows. Raises InputError where a trial failed; the others were run."""
        if self.failures:
            runs = counted(len(self.rows) + len(self.failures), "run")
            raise InputError(
                f"{len(self.failures)} of {runs} failed; first error: {next(iter(self.failures.values()))}; "
                "the same command tries again"
            )
        return self.rows


def trials_of(
    experiment: Experiment, captures: Iterable[Path], out: Path, settings: AdaAnchor4DSettings, seeds: int
) -> list[Trial]:
    """Seed by seed from the settings' own, so that a table of what is done so far compares like with like.

    Raises:
        InputError: two captures have one name.
    """
    folders = list(captures)
    names = [folder.resolve().name for folder in folders]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{folders[names.index(name)]}: two captures are called {name!r}; rename a folder")
    return [
        Trial(
            capture=folder.resolve(),
            label=variant.label,
            seed=seed,
            settings=replace(variant.settings(settings), seed=seed),
            base=settings,
            out=out / folder.resolve().name / variant.label.replace(" ", "-") / f"seed{seed}",
        )
        for seed in range(settings.seed, settings.seed + seeds)
        for folder in folders
        for variant in experiment.variants
    ]


def task_of(trial: Trial, capture: Capture, out: Path) -> Task:
    """
    Args:
        capture: the one at `trial.capture`.
        out: the folder of the experiment, which holds the trial's.
    """
    from aa4d.training.trainer import description_of

    settings = trial.settings
    return Task(
        "trial",
        trial.name,
        TrialRun.of(trial.label, trial.capture, settings, description_of(capture, settings)),
        units=iterations_of(settings),
        alike=f"{settings.method} {trial.capture.name}",
        place=trial.out.relative_to(out).as_posix(),
    )


def claim(experiment: Experiment, trials: list[Trial], captures: dict[Path, Capture], out: Path) -> dict[str, Any]:
    """Take `out` for the experiment. More seeds and more captures may be added to it later, other settings may not.

    Returns:
        The index that `out` is to have, once its trials have been looked at too.

    Raises:
        InputError: `out` holds something else, or runs with other settings or of other captures.
    """
    index = claim_folder(out, INDEX, {"experiment": experiment.name}, "the runs of an experiment")
    before, found, earlier = index.get("captures", {}), index.get("training", {}), index.get("seeds", [])
    are_tables = isinstance(before, dict) and isinstance(found, dict)
    if not are_tables or not isinstance(earlier, list) or not all(type(seed) is int for seed in earlier):
        raise InputError(f"{out / INDEX}: is damaged; delete it to go on with the runs that are there")
    # Through JSON, so that tuples and lists compare alike.
    base = replace(trials[0].base, seed=0)
    training, counts = json.loads(json.dumps([asdict(base), what_counts(base)]))
    different = difference(_completed(index.get("training", training), training, counts), training, "training")
    if different is not None:
        raise InputError(f"{out}: holds runs with another {different}; choose another --out, or delete that folder")
    named = {folder.name: capture.identity.digest() for folder, capture in captures.items()}
    for folder in captures:
        if before.get(folder.name, named[folder.name]) != named[folder.name]:
            raise InputError(
                f"{out}: its runs of {folder.name} were made from another capture than {folder} is now; choose another "
                "--out, or delete that folder"
            )
    seeds = sorted({*earlier, *(trial.seed for trial in trials)})
    return index | {"training": training, "captures": before | named, "seeds": seeds}


def _completed(found: dict[str, Any], training: dict[str, Any], counts: dict[str, Any]) -> dict[str, Any]:
    """The settings in an index, and those that are off today and that the version that wrote it did not know."""
    tables = [key for key in found if all(isinstance(of.get(key), dict) for of in (found, training, counts))]
    inner = {key: _completed(found[key], training[key], counts[key]) for key in tables}
    return found | inner | {key: training[key] for key in training if key not in found and key not in counts}


def run_experiment(
    experiment: Experiment,
    trials: list[Trial],
    out: Path,
    engine: Engine,
    listen: Callable[[list[Task]], Tell],
    write: Callable[[Outcome], object],
) -> Outcome:
    """Run what has not been run; a trial that fails does not stop the others.

    Args:
        listen: whoever hears of the tasks, once they are known.
        write: writes the tables; called after each trial.

    Raises:
        InputError: a capture cannot be read, `out` holds other runs, or another process works there.
        Interrupted: Ctrl-C; what was running is saved.
    """
    captures = {folder: read_capture(folder) for folder in dict.fromkeys(trial.capture for trial in trials)}
    for folder in captures:
        check_content(folder)
    index = claim(experiment, trials, captures, out)
    with claimed(out, "running an experiment"):
        store, tasks = Store(out), [task_of(trial, captures[trial.capture], out) for trial in trials]
        for task in tasks:
            store.kept(task, {})  # what must not be overwritten is refused before anything is written
        write_json(out / INDEX, index)
        rows: dict[str, Row] = {}
        failures: dict[str, str] = {}

        def outcome() -> Outcome:
            names = [trial.name for trial in trials]
            return Outcome([rows[n] for n in names if n in rows], {n: failures[n] for n in names if n in failures})

        tell = listen(tasks)

        def hear(event: Event) -> None:
            tell(event)
            if isinstance(event, Finished):
                rows[event.task.name] = event.kept.result
            elif isinstance(event, Failed):
                failures[event.task.name] = event.sentence
            if isinstance(event, Failed) or (isinstance(event, Finished) and not event.before):
                write(outcome())

        run_graph(tasks, store, engine, hear)
        write(outcome())
        return outcome()
