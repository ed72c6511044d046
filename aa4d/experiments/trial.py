"""One trial: a variant trained on a capture with a seed, and scored. An ordinary run folder, and its row of a table."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from aa4d import __version__
from aa4d.capture.reader import Capture, read_capture
from aa4d.errors import InputError, Interrupted
from aa4d.files import read_json_object, write_json
from aa4d.methods.settings import RunSettings
from aa4d.training.schedule import schedule_of

Row = dict[str, float | str]
RESULT = "trial.json"
TEXTS = ("capture", "variant", "run", "version")  # of a row; all else in it is a number
REPORT_EVERY = 10  # iterations
ORPHANED_S = 0.5  # seconds from one look after the parent to the next


@dataclass(frozen=True)
class Trial:
    capture: Path
    label: str
    seed: int
    settings: RunSettings
    base: RunSettings  # without what the variant changes
    out: Path  # the run's folder

    @property
    def iterations(self) -> int:
        return schedule_of(self.settings).total

    @property
    def name(self) -> str:
        return f"{self.capture.name}, {self.label}, seed {self.seed}"


def finished_row(trial: Trial, capture: Capture) -> Row | None:
    """The row of a trial that has been run; None where it has not, or its row is damaged or another version's.

    Args:
        capture: the one at `trial.capture`.

    Raises:
        InputError: the folder holds a run of another capture or with other settings.
    """
    from aa4d.training.run_folder import check_folder
    from aa4d.training.trainer import description_of

    description = description_of(capture, trial.settings)
    check_folder(trial.out, description)
    result = trial.out / RESULT
    if not result.exists():
        return None
    row: Row = read_json_object(result, "the result of a trial")
    made_by = _made_by(description)
    # A row of an older version says neither: its run's settings have just been compared.
    is_current = all(row.get(key, value) == value for key, value in made_by.items())
    return row if is_current and _is_whole(row, trial) else None


def _named(trial: Trial) -> Row:
    return {"capture": trial.capture.name, "variant": trial.label, "seed": trial.seed}


def _is_whole(row: Row, trial: Trial) -> bool:
    """Whether a row that was read is one of this trial: what stands in none is measured again."""
    values = [value for key, value in row.items() if key not in TEXTS]
    are_numbers = all(isinstance(value, int | float) and abs(value) <= sys.float_info.max for value in values)
    return are_numbers and "psnr" in row and _named(trial).items() <= row.items()


def _made_by(settings: dict[str, Any]) -> dict[str, str]:
    """The run and the version that a row was measured with."""
    from aa4d.training.run_folder import run_identity

    return {"run": run_identity(settings).digest(), "version": __version__}


def run_trial(trial: Trial, progress: Callable[[int], None]) -> Row:
    """Train and score; `progress` hears of the iterations done. Raises what training and evaluation raise."""
    from aa4d.evaluation.evaluate import evaluate
    from aa4d.training.trainer import description_of, train

    schedule = schedule_of(trial.settings)

    def tell(stage: str, iteration: int, *_: object) -> None:
        if iteration % REPORT_EVERY == 0:
            progress(schedule.iterations_before(stage) + iteration)

    capture = read_capture(trial.capture)
    train(capture, trial.out, trial.settings, tell)
    metrics = evaluate(trial.out, trial.capture, lambda *_: None).as_json()
    made_by = _made_by(description_of(capture, trial.settings))
    row = _named(trial) | numbers(metrics) | made_by
    write_json(trial.out / RESULT, row)
    return row


def numbers(metrics: dict[str, Any]) -> Row:
    """Every number of an evaluation, those of an object as "object.key"; lists, None and the identity are left out."""
    row: Row = {}
    for key, value in metrics.items():
        if key == "identity":
            continue
        if isinstance(value, dict):
            row |= {f"{key}.{inner}": number for inner, number in numbers(value).items()}
        elif isinstance(value, int | float):
            row[key] = value
    return row


def trial_process(trial: Trial, threads: int | None, parent: Connection) -> None:
    """A trial in a process of its own. Sends ("done", iterations), then ("row", row) or ("failed", sentence).

    It leaves the terminal's process group, so that Ctrl-C reaches it once, from the parent; and it ends where the
    parent is gone, so that the same command finds the run's folder free.
    """
    os.setpgrp()
    starter = multiprocessing.parent_process()  # it may be gone already: then somebody else is the parent
    threading.Thread(target=_end_with, args=(starter and starter.pid,), daemon=True).start()
    try:
        import torch

        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        if threads is not None:
            torch.set_num_threads(threads)
        parent.send(("row", run_trial(trial, lambda iterations: parent.send(("done", iterations)))))
    except InputError as error:
        parent.send(("failed", str(error)))
    except Interrupted as stop:
        parent.send(("stopped", str(stop)))
    except (BrokenPipeError, KeyboardInterrupt):
        pass
    except Exception as error:
        parent.send(("failed", f"{trial.out}: {type(error).__name__}: {error}"))
        raise


def _end_with(parent: int | None) -> None:
    """A run is whole on disk at every moment: to stop at once loses what follows its last checkpoint."""
    while os.getppid() == parent:
        time.sleep(ORPHANED_S)
    os._exit(1)


def stop(pid: int | None) -> None:
    """Ask a trial's process to save and stop."""
    if pid is not None:
        os.kill(pid, signal.SIGINT)
