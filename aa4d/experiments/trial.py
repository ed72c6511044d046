"""One trial: a variant trained on a capture with a seed, and scored. An ordinary run folder, and its row of a table."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from aa4d.capture.reader import read_capture
from aa4d.errors import InputError, Interrupted
from aa4d.files import read_json_object, write_json
from aa4d.methods.settings import RunSettings
from aa4d.training.schedule import schedule_of

Row = dict[str, float | str]
RESULT = "trial.json"
REPORT_EVERY = 10  # iterations


@dataclass(frozen=True)
class Trial:
    capture: Path
    label: str
    seed: int
    settings: RunSettings
    out: Path  # the run's folder

    @property
    def iterations(self) -> int:
        return schedule_of(self.settings).total

    @property
    def name(self) -> str:
        return f"{self.capture.name}, {self.label}, seed {self.seed}"


def finished_row(trial: Trial) -> Row | None:
    """The row of a trial that has been run; None where it has not.

    Raises:
        InputError: the folder holds a run of another capture or with other settings.
    """
    from aa4d.training.run_folder import check_folder
    from aa4d.training.trainer import description_of

    capture = read_capture(trial.capture)
    check_folder(trial.out, description_of(capture, trial.settings))
    result = trial.out / RESULT
    return read_json_object(result, "the result of a trial") if result.exists() else None


def run_trial(trial: Trial, progress: Callable[[int], None]) -> Row:
    """Train and score; `progress` hears of the iterations done. Raises what training and evaluation raise."""
    from aa4d.evaluation.evaluate import evaluate
    from aa4d.training.trainer import train

    schedule = schedule_of(trial.settings)

    def tell(stage: str, iteration: int, *_: object) -> None:
        if iteration % REPORT_EVERY == 0:
            progress(schedule.iterations_before(stage) + iteration)

    train(read_capture(trial.capture), trial.out, trial.settings, tell)
    metrics = evaluate(trial.out, trial.capture, lambda *_: None).as_json()
    row: Row = {"capture": trial.capture.name, "variant": trial.label, "seed": trial.seed, **numbers(metrics)}
    write_json(trial.out / RESULT, row)
    return row


def numbers(metrics: dict[str, Any]) -> Row:
    """Every number of an evaluation, those of an object as "object.key"; lists and None are left out."""
    row: Row = {}
    for key, value in metrics.items():
        if isinstance(value, dict):
            row |= {f"{key}.{inner}": number for inner, number in numbers(value).items()}
        elif isinstance(value, int | float):
            row[key] = value
    return row


def trial_process(trial: Trial, threads: int | None, parent: Connection) -> None:
    """A trial in a process of its own. Sends ("done", iterations), then ("row", row) or ("failed", sentence).

    It leaves the terminal's process group, so that Ctrl-C reaches it once, from the parent; and it ends at its next
    report where the parent is gone.
    """
    os.setpgrp()
    import torch

    if threads is not None:
        torch.set_num_threads(threads)
    try:
        parent.send(("row", run_trial(trial, lambda iterations: parent.send(("done", iterations)))))
    except InputError as error:
        parent.send(("failed", str(error)))
    except Interrupted as stop:
        parent.send(("stopped", str(stop)))
    except (BrokenPipeError, KeyboardInterrupt):
        pass


def stop(pid: int | None) -> None:
    """Ask a trial's process to save and stop."""
    if pid is not None:
        os.kill(pid, signal.SIGINT)
