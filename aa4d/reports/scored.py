"""A run that was scored, as its files say: scores of every frame, what it drew, how it was trained."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from safetensors import safe_open

from aa4d.capture.reader import Capture, read_capture
from aa4d.errors import InputError
from aa4d.files import read_json_object
from aa4d.identity import digest_of, identity_of
from aa4d.inspection.history import Row as HistoryRow
from aa4d.inspection.history import read_history
from aa4d.reports.pictures import Pixels
from aa4d.training.run_folder import SETTINGS

METRICS = "metrics.json"
DRAWN = "eval"  # folder of the pictures
COARSE = "_static"  # ending of the coarse stage's


@dataclass(frozen=True)
class ScoredRun:
    """Where its scores lie, and where it was trained; mostly that is one folder."""

    folder: Path
    trained: Path
    metrics: dict[str, Any]

    @property
    def digest(self) -> str:
        """Of the scores; those of an older version have no identity and are taken as they are."""
        identity = identity_of(self.metrics.get("identity"))
        return digest_of(self.metrics) if identity is None else identity.digest()

    @property
    def frames(self) -> list[dict[str, Any]]:
        """Scores of held-out frames, in order of time."""
        frames: list[dict[str, Any]] = self.metrics["frames"]
        return frames

    def drawn(self, frame: str, ending: str = "") -> Pixels | None:
        """What evaluation drew of a frame; None where it is not there. Raises InputError for a damaged picture."""
        path = self.folder / DRAWN / f"{frame}{ending}.png"
        try:
            return _pixels(path) if path.is_file() else None
        except (OSError, SyntaxError, ValueError) as error:
            raise InputError(f"{path}: cannot be read as a picture ({error}); {_again(self.trained)}") from None

    def missing(self) -> str | None:
        """A sentence where held-out frames have no picture."""
        count = sum(not (self.folder / DRAWN / f"{frame['frame']}.png").is_file() for frame in self.frames)
        if not count:
            return None
        name = self.folder.resolve().name
        return f"{count} of {len(self.frames)} held-out frames of {name} have no picture; aa4d eval draws them again."

    def description(self) -> dict[str, Any]:
        """`config.json` of the training; empty where it is not there or damaged."""
        try:
            return read_json_object(self.trained / SETTINGS, "the settings of a training run")
        except InputError:
            return {}

    def history(self) -> list[HistoryRow] | None:
        return read_history(self.trained / "history.csv")


@lru_cache(maxsize=48)
def _pixels(path: Path) -> Pixels:
    """Of a picture that a page shows in several places."""
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


def scored_run(folder: Path, trained: Path | None = None) -> ScoredRun:
    """Raises InputError where the scores are damaged or not there."""
    trained = trained or folder
    path = folder / METRICS
    if not path.exists():
        raise InputError(f"{folder}: has not been scored; run `aa4d eval {folder}` first")
    metrics = read_json_object(path, "the scores of a run")
    fault = _fault(metrics)
    if fault is not None:
        raise InputError(f"{path}: is damaged or of an older version ({fault}); {_again(trained)}")
    return ScoredRun(folder, trained, metrics)


def _again(run: Path) -> str:
    return f"run `aa4d eval {run}` again"


def _fault(metrics: dict[str, Any]) -> str | None:
    """What is wrong with the scores that pages show, None where nothing is."""
    if not _is_number(metrics.get("psnr")):
        return "psnr is no number"
    frames = metrics.get("frames")
    if not isinstance(frames, list) or not frames:
        return "frames is no list of scores"
    for n, frame in enumerate(frames):
        if not isinstance(frame, dict):
            return f"frames[{n}] is no object"
        name = frame.get("frame")
        if not isinstance(name, str) or not name or Path(name).name != name or "\\" in name:
            return f"frames[{n}].frame is no name of a frame"
        for key in ("t", "psnr"):
            if not _is_number(frame.get(key)):
                return f"frames[{n}].{key} is no number"
        for key in ("psnr_dynamic", "psnr_still", "ssim", "moving_share"):
            if frame.get(key) is not None and not _is_number(frame[key]):
                return f"frames[{n}].{key} is no number"
    return None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


@dataclass
class Captures:
    """The captures of runs: where a run says that it was trained, or among folders that were named."""

    named: Sequence[Path] = ()
    notes: list[str] = field(default_factory=list)  # on what a page has to do without, each once
    _found: dict[str, Capture | None] = field(default_factory=dict)

    def of(self, run: ScoredRun) -> Capture | None:
        """None where it is not there any more, or another one lies there.

        Raises:
            InputError: a named folder is no capture, or the capture is damaged.
        """
        description = run.description()
        wanted, places = _wanted(run, description), _places(run, description)
        key = wanted or str(places)
        if key not in self._found:
            self._found[key] = self._look(wanted, places)
        return self._found[key]

    def _look(self, wanted: str | None, places: list[Path]) -> Capture | None:
        there = [folder for folder in places if (folder / "capture.json").is_file()]
        for folder in (*self.named, *there):
            capture = read_capture(folder, to_train=False)
            if wanted in (capture.identity.digest(), capture.fingerprint):
                return capture
        name = places[-1].name if places else "of a run"
        why = "is not what it was" if there else "is not where it was"
        self.tell(f"The capture {name} {why}: its true frames are left out (--captures says where it lies).")
        return None

    def tell(self, note: str) -> None:
        if note not in self.notes:
            self.notes.append(note)


def _places(run: ScoredRun, description: dict[str, Any]) -> list[Path]:
    """Where a run's capture may lie: as seen from its model file, and where it lay when the training began."""
    places = []
    with suppress(Exception):  # a damaged model file is nothing that a page needs
        model = run.trained / "model.safetensors"
        with safe_open(str(model), "numpy") as file:
            places.append((model.parent / json.loads(file.metadata()["aa4d"])["capture"]).resolve())
    if isinstance(description.get("capture"), str):
        places.append(Path(description["capture"]))
    return places


def _wanted(run: ScoredRun, description: dict[str, Any]) -> str | None:
    """Identity of the capture that a run was scored on, or trained on; of an older run the index's fingerprint."""
    for holder in (run.metrics, description):
        identity = identity_of(holder.get("identity"))
        if identity is not None and "capture" in identity.made_from:
            return identity.made_from["capture"]
    found = description.get("capture_fingerprint")
    return found if isinstance(found, str) else None
