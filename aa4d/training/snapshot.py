"""The model of a run whose training still goes on, from its last checkpoint."""

from __future__ import annotations

import tempfile
from pathlib import Path

import torch

from aa4d.capture.reader import Capture
from aa4d.errors import InputError
from aa4d.methods import method_of
from aa4d.methods.given import given_settings
from aa4d.methods.model_file import LoadedModel, load_model
from aa4d.settings.given import Given
from aa4d.training.frames import training_frames
from aa4d.training.trainer import Run


def run_of(folder: Path, capture: Capture) -> Run:
    """A run as its folder says; every training picture is read.

    Raises:
        InputError: the settings in the folder or the pictures cannot be read, or none can be of this capture.
    """
    settings = given_settings(Given.by(folder / "settings.toml"))
    settings = method_of(settings.method).resolved(settings, len(capture.frames))
    return Run(training_frames(capture, torch.device("cpu")), folder, settings)


def snapshot(run: Run) -> tuple[LoadedModel, str]:
    """The model of the last checkpoint, and how far that is.

    Raises:
        InputError: there is none, or it is damaged.
    """
    if not run.checkpoint_path.exists():
        raise InputError(f"{run.out}: has no checkpoint yet; wait for the first one")
    state = run.last_good_state()
    with tempfile.TemporaryDirectory(prefix="aa4d-") as folder:
        path = Path(folder) / "model.safetensors"
        run.write_model(state, path)
        loaded = load_model(path)
    return loaded, f"{state.stage}, iteration {state.iteration} of {run.schedule[state.stage].iterations}"
