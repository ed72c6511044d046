"""The extension's reader and aa4d's judge the same files alike, and make the same numbers of them."""

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bad_model_files import BAD_FILES, GOOD_FILES, OVERFLOWING, OVERSIZED

from addon.field import anchor_positions, prepare, to_world
from addon.model import read_model

torch = pytest.importorskip("torch")
model_file = pytest.importorskip("aa4d.methods.model_file")


@pytest.mark.parametrize("kind", BAD_FILES)
def test_what_the_extension_refuses_aa4d_refuses(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "model.safetensors"
    BAD_FILES[kind][0](path)
    with pytest.raises(importlib.import_module("aa4d.errors").InputError, match=r"^.*model\.safetensors: [^\n]+$"):
        model_file.load_model(path)


@pytest.mark.parametrize("kind", GOOD_FILES)
def test_what_is_good_for_one_is_good_for_the_other(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "model.safetensors"
    GOOD_FILES[kind](path)
    ours, theirs = read_model(path), model_file.load_model(path)
    assert header_of(ours) == {
        "static": theirs.is_static,
        "scale": theirs.frame.unit_m,
        "translation": theirs.frame.origin_m.tolist(),
        "fps": theirs.fps,
        "size": (theirs.camera.width, theirs.camera.height),
        "K": theirs.camera.K.tolist(),
        "images": tuple(frame.image for frame in theirs.frames),
        "viewmats": [frame.viewmat.tolist() for frame in theirs.frames],
        "background": theirs.background,
    }
    field = prepare(ours)
    for t in (0.0, 0.41, 1.0):
        with torch.no_grad():
            expected = theirs.model.centers(None if theirs.is_static else t).numpy()
        found = anchor_positions(field, t)
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=2e-5)
        assert np.isfinite(to_world(ours, found)).all()


def header_of(model: Any) -> dict[str, Any]:
    return {
        "static": model.static,
        "scale": model.scale,
        "translation": model.translation.tolist(),
        "fps": model.fps,
        "size": (model.camera.width, model.camera.height),
        "K": model.camera.K.tolist(),
        "images": model.images,
        "viewmats": model.viewmats.tolist(),
        "background": model.background,
    }


@pytest.mark.parametrize("write", [*OVERFLOWING.values(), OVERSIZED])
def test_files_of_models_that_cannot_be_evaluated_are_files_for_both(write: Any, tmp_path: Path) -> None:
    path = tmp_path / "model.safetensors"
    write(path)
    assert read_model(path).fps == model_file.load_model(path).fps
