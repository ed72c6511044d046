"""A run on disk, watched: what it shows now, and again when its training has written more."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open

from aa4d.capture.reader import Capture, read_capture
from aa4d.errors import InputError
from aa4d.evaluation.evaluate import capture_of
from aa4d.files import read_json_object
from aa4d.methods.model_file import LoadedModel, load_model
from aa4d.training.run_folder import SETTINGS
from aa4d.training.snapshot import run_of, snapshot
from aa4d.training.trainer import Run
from aa4d.viewer.footage import Footage
from aa4d.viewer.shown import Shown

MODEL, CHECKPOINT = "model.safetensors", "checkpoint.safetensors"
SAME_PLACE = 1e-3  # of the model's unit: so near to a frame's camera its picture fits


class Followed:
    """One run. While it trains it has a checkpoint now and then, and a model file at the end."""

    def __init__(self, folder: Path, capture: Path | None) -> None:
        """`capture`: where that lies, or None to follow the run's own word."""
        self.folder = folder
        self._named = capture
        self._capture: Capture | None = None
        self._run: Run | None = None  # what a checkpoint needs beside itself
        self._seen: tuple[Any, ...] = ()

    def load(self) -> Shown:
        """What the run shows now.

        Raises:
            InputError: it has no model and no checkpoint, or what it has is damaged.
        """
        self._seen = self._stamps()
        loaded, state = self._newest()
        if self._capture is None and (self._named is not None or _is_there(loaded)):
            self._capture = capture_of(loaded, self._named)
        footage = None
        if self._capture is not None:
            footage = Footage(self._capture, loaded.frames, SAME_PLACE * loaded.frame.unit_m)
        return Shown(self.folder.resolve().name, loaded, state, footage)

    def news(self) -> Shown | None:
        """What the run shows, where its files are other ones than when they were last read.

        Raises:
            InputError: what is new cannot be read.
        """
        return None if self._stamps() == self._seen else self.load()

    def _stamps(self) -> tuple[Any, ...]:
        stamps: list[Any] = []
        for name in (MODEL, CHECKPOINT):
            try:
                status = (self.folder / name).stat()
                stamps.append((status.st_mtime_ns, status.st_size))
            except OSError:
                stamps.append(None)
        return tuple(stamps)

    def _newest(self) -> tuple[LoadedModel, str]:
        model, checkpoint = self.folder / MODEL, self.folder / CHECKPOINT
        if not self.folder.exists():
            raise InputError(f"{self.folder}: no such folder; name that of a run, made by `aa4d train`")
        if not model.exists() and not checkpoint.exists():
            if (self.folder / SETTINGS).exists():
                raise InputError(f"{self.folder}: its training has written no checkpoint yet; wait for the first one")
            if self.folder.is_dir():
                raise InputError(f"{self.folder}: holds no model; name the folder of a run, made by `aa4d train`")
        if not model.exists() and checkpoint.exists():
            return self._of_checkpoint()
        iterations, header = _iterations(model, "aa4d", "training"), None
        if checkpoint.exists() and checkpoint.stat().st_mtime_ns > model.stat().st_mtime_ns:
            header = _iterations(checkpoint, "state")
        if header is not None and header != iterations:  # a run that goes on after it was stopped
            return self._of_checkpoint()
        loaded = load_model(model)
        stage = "static stage" if loaded.is_static else "trained"
        return loaded, stage if iterations is None else f"{stage}, {iterations} iterations"

    def _of_checkpoint(self) -> tuple[LoadedModel, str]:
        if self._run is None:
            said = read_json_object(self.folder / SETTINGS, "the settings of a training run").get("capture")
            self._capture = read_capture(self._named or Path(str(said)))
            self._run = run_of(self.folder, self._capture)
        loaded, state = snapshot(self._run)
        return replace(loaded, path=self._run.checkpoint_path), f"training: {state}"


def _is_there(loaded: LoadedModel) -> bool:
    return loaded.capture_folder is not None and loaded.capture_folder.is_dir()


def _iterations(path: Path, key: str, section: str | None = None) -> int | None:
    """What a file's header says of its iterations; None where it says nothing."""
    try:
        with safe_open(str(path), framework="pt") as file:
            header = json.loads((file.metadata() or {})[key])
        value = (header if section is None else header[section])["iterations" if section else "iteration"]
    except (SafetensorError, OSError, KeyError, TypeError, ValueError, RecursionError):
        return None
    return value if isinstance(value, int) else None
