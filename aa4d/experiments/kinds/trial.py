"""A trial: a variant trained on a capture with a seed, and scored. An ordinary run folder, and its row of a table."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aa4d import __version__
from aa4d.errors import InputError
from aa4d.experiments.kinds.evaluate import Row, numbers
from aa4d.experiments.kinds.train import fit
from aa4d.files import read_json_object, write_json
from aa4d.graph.call import Call
from aa4d.graph.kinds import Kept, Kind
from aa4d.graph.task import Task, location
from aa4d.identity import digest_of, digest_of_file
from aa4d.methods.settings import RunSettings
from aa4d.training.run_folder import check_folder, run_identity

RESULT = "trial.json"
MODEL = "model.safetensors"
# By what a hand in the result is noticed: digests of the rest of the row, and of the model that it scores.
SUM, SCORED = "sum", "model"
TEXTS = ("capture", "variant", "run", "version")  # of a row; all else in it is a number


@dataclass(frozen=True)
class TrialRun:
    """What tells one trial from another is the identity of its run."""

    run: str  # digest of that identity
    label: str
    seed: int
    capture: Path = location()
    settings: RunSettings = location()
    description: dict[str, Any] = location()  # `config.json` of the run

    @property
    def made_by(self) -> dict[str, str]:
        """The run and the version that a row was measured with."""
        return {"run": self.run, "version": __version__}

    @property
    def named(self) -> Row:
        """What a row begins with."""
        return {"capture": self.capture.name, "variant": self.label, "seed": self.seed}

    @staticmethod
    def of(label: str, capture: Path, settings: RunSettings, description: dict[str, Any]) -> TrialRun:
        run = run_identity(description).digest()
        return TrialRun(run, label, settings.seed, capture, settings, description)


def run(call: Call) -> dict[str, Any]:
    """The row. Raises what training and evaluation raise."""
    from aa4d.capture.reader import read_capture
    from aa4d.evaluation.evaluate import evaluate

    trial: TrialRun = call.task.settings
    if (edited := _edited(call.folder, _row(call.folder) or {})) is not None:
        call.say(f"{edited} is not as it was made; {call.task.title} is made again")
        (call.folder / MODEL).unlink(missing_ok=True)  # it is written anew from the last checkpoint
    fit(call, read_capture(trial.capture), trial.settings)
    metrics = evaluate(call.folder, trial.capture, lambda *_: None).as_json()
    row = trial.named | numbers(metrics) | trial.made_by
    marked = row | {SCORED: digest_of_file(call.folder / MODEL)}
    write_json(call.folder / RESULT, marked | {SUM: digest_of(marked)})
    return row


def kept(task: Task, folder: Path) -> Kept | None:
    """The row of a trial that has been run; None where it has not, its row is damaged or another version's, or the row
    or the model was edited by hand.

    Raises:
        InputError: the folder holds a run of another capture or with other settings.
    """
    trial: TrialRun = task.settings
    check_folder(folder, trial.description)
    marked = _row(folder)
    if marked is None or _edited(folder, marked) is not None:
        return None
    row = {key: value for key, value in marked.items() if key not in (SUM, SCORED)}
    # A row of an older version says neither: its run's settings have just been compared.
    if any(row.get(key, value) != value for key, value in trial.made_by.items()) or not _is_whole(row, trial):
        return None
    seconds = row.get("training_seconds")
    return Kept(row, seconds if isinstance(seconds, float) else None, digest_of(row))


def _row(folder: Path) -> Row | None:
    try:
        return read_json_object(folder / RESULT, "the result of a trial")
    except InputError:
        return None


def _edited(folder: Path, marked: Row) -> Path | None:
    """What is not as it was when the row was written; rows of older versions do not tell."""
    rest = {key: value for key, value in marked.items() if key != SUM}
    try:
        if SUM in marked and marked[SUM] != digest_of(rest):
            return folder / RESULT
    except ValueError:  # a number that is none
        return folder / RESULT
    model = folder / MODEL
    if SCORED in marked and model.exists() and marked[SCORED] != digest_of_file(model):
        return model
    return None


def _is_whole(row: Row, trial: TrialRun) -> bool:
    """Whether a row that was read is one of this trial: what stands in none is measured again."""
    values = [value for key, value in row.items() if key not in TEXTS]
    are_numbers = all(isinstance(value, int | float) and abs(value) <= sys.float_info.max for value in values)
    return are_numbers and "psnr" in row and trial.named.items() <= row.items()


KIND = Kind(run, version=__version__, kept=kept)
