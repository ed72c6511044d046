"""The toy model as a clip of its two held-out frames."""

from pathlib import Path

import pytest

from aa4d.export.clip import (
    Clip,
)
from aa4d.filming.camera_path import path_of_frames
from aa4d.methods.model_file import LoadedModel, load_model


@pytest.fixture(scope="module")
def loaded(toy_run: Path) -> LoadedModel:
    return load_model(toy_run / "model.safetensors")


@pytest.fixture(scope="module")
def clip(loaded: LoadedModel) -> Clip:
    return Clip(loaded, path_of_frames(loaded, "held-out"), None)
