"""All trials of an experiment, some at a time; what is done stays done."""

from __future__ import annotations

import json
import multiprocessing
import signal
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field, replace
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Protocol

from aa4d.capture.content import check_content
from aa4d.capture.reader import Capture, read_capture
from aa4d.errors import InputError, Interrupted
from aa4d.experiments.trial import Row, Trial, finished_row, stop, trial_process
from aa4d.experiments.variants import Experiment
from aa4d.files import claimed, write_json
from aa4d.methods.adaanchor4d.settings import AdaAnchor4DSettings
from aa4d.output_folder import claim_folder
from aa4d.training.run_folder import difference

INDEX = "experiment.json"


class Watcher(Protocol):
    """Whoever shows how far it is."""

    def start(self, trials: int, finished: int, iterations: int) -> None: ...
    def trial_started(self, name: str) -> None: ...
    def trial_at(self, name: str, iterations: int) -> None: ...
    def trial_ended(self, name: str, sentence: str) -> None: ...


@dataclass(frozen=True)
class Outcome:
    """What the trials of an experiment came to, in the order of the trials."""

    rows: list[Row]
    failures: dict[str, str] = field(default_factory=dict)  # a sentence by the trial's name

    def checked(self) -> list[Row]:
        """The rows. Raises InputError where a trial failed; the others were run."""
        if self.failures:
            runs = len(self.rows) + len(self.failures)
            raise InputError(
                f"{len(self.failures)} of {runs} runs failed; first error: {next(iter(self.failures.values()))}; "
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


def claim(experiment: Experiment, trials: list[Trial], captures: dict[Path, Capture], out: Path) -> dict[str, Any]:
    """Take `out` for the experiment. More seeds and more captures may be added to it later, other settings may not.

    Returns:
        The index that `out` is to have, once its trials have been looked at too.

    Raises:
        InputError: `out` holds something else, or runs with other settings or of other captures.
    """
    index = claim_folder(out, INDEX, {"experiment": experiment.name}, "the runs of an experiment")
    # Through JSON, so that tuples and lists compare alike.
    training = json.loads(json.dumps(asdict(replace(trials[0].base, seed=0))))
    different = difference(index.get("training", training), training, "training")
    if different is not None:
        raise InputError(f"{out}: holds runs with another {different}; choose another --out, or delete that folder")
    named = {folder.name: capture.identity.digest() for folder, capture in captures.items()}
    before, earlier = index.get("captures", {}), index.get("seeds", [])
    if not isinstance(before, dict) or not isinstance(earlier, list) or not all(type(s) is int for s in earlier):
        raise InputError(f"{out / INDEX}: is damaged; delete it to go on with the runs that are there")
    for folder in captures:
        if before.get(folder.name, named[folder.name]) != named[folder.name]:
            raise InputError(
                f"{out}: its runs of {folder.name} were made from another capture than {folder} is now; choose another "
                "--out, or delete that folder"
            )
    seeds = sorted({*earlier, *(trial.seed for trial in trials)})
    return index | {"training": training, "captures": before | named, "seeds": seeds}


def run_experiment(
    experiment: Experiment,
    trials: list[Trial],
    out: Path,
    jobs: int,
    watcher: Watcher,
    write: Callable[[Outcome], object],
) -> Outcome:
    """Run what has not been run, `jobs` trials at a time; one that fails does not stop the others.

    Args:
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
        return _run(trials, captures, out / INDEX, index, jobs, watcher, write)


def _run(
    trials: list[Trial],
    captures: dict[Path, Capture],
    index_path: Path,
    index: dict[str, Any],
    jobs: int,
    watcher: Watcher,
    write: Callable[[Outcome], object],
) -> Outcome:
    rows: dict[str, Row] = {}
    failures: dict[str, str] = {}
    waiting: list[Trial] = []
    for trial in trials:
        row = finished_row(trial, captures[trial.capture])
        if row is None:
            waiting.append(trial)
        else:
            rows[trial.name] = row
    write_json(index_path, index)
    watcher.start(len(trials), len(rows), sum(trial.iterations for trial in waiting))
    # With one job torch chooses its threads; several jobs of one thread each get more done than one with several.
    running = Processes(threads=1 if jobs > 1 else None)

    def outcome() -> Outcome:
        named = [trial.name for trial in trials]
        return Outcome(
            [rows[name] for name in named if name in rows], {name: failures[name] for name in named if name in failures}
        )

    try:
        while waiting or running.trials:
            while waiting and len(running.trials) < jobs:
                trial = waiting.pop(0)
                running.start(trial)
                watcher.trial_started(trial.name)
            for trial, kind, value in running.messages():
                if kind == "done":
                    watcher.trial_at(trial.name, int(value))  # type: ignore[call-overload]
                    continue
                if kind == "row" and isinstance(value, dict):
                    rows[trial.name] = value
                    watcher.trial_at(trial.name, trial.iterations)
                    watcher.trial_ended(trial.name, f"{float(value['psnr']):.2f} dB")
                else:
                    failures[trial.name] = str(value)
                    watcher.trial_ended(trial.name, str(value))
                write(outcome())
    except KeyboardInterrupt:
        running.stop()
        raise Interrupted(
            f"stopped; {len(rows)} of {len(trials)} runs are done, and the same command continues"
        ) from None
    write(outcome())
    return outcome()


class Processes:
    """The trials that run now, each in a process of its own."""

    def __init__(self, threads: int | None) -> None:
        self._threads = threads
        # Not forked: torch's threads do not survive that.
        self._context = multiprocessing.get_context("spawn")
        self.trials: dict[Connection, tuple[Trial, BaseProcess]] = {}

    def start(self, trial: Trial) -> None:
        ours, theirs = self._context.Pipe(duplex=False)
        process = self._context.Process(target=trial_process, args=(trial, self._threads, theirs))
        resource_tracker.ensure_running()  # else the first start begins it, which lifts the block
        # The process inherits the block, and takes Ctrl-C once it can answer it (`trial_process`).
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        theirs.close()
        self.trials[ours] = (trial, process)

    def messages(self) -> Iterable[tuple[Trial, str, object]]:
        """Wait for the next ones. A process that has said its last, or died, is gone afterwards."""
        for connection in wait(list(self.trials)):
            assert isinstance(connection, Connection)
            trial, process = self.trials[connection]
            try:
                kind, value = connection.recv()
            except EOFError:
                process.join()
                kind, value = "failed", f"{trial.out}: its process died (exit code {process.exitcode})"
            if kind != "done":
                process.join()
                connection.close()
                del self.trials[connection]
            yield trial, kind, value

    def stop(self) -> None:
        """Let all of them save and end."""
        for _, process in self.trials.values():
            stop(process.pid)
        for connection, (_, process) in self.trials.items():
            try:
                while connection.recv()[0] == "done":
                    pass
            except EOFError:
                pass
            process.join()
