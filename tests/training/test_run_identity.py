"""A run knows its capture and its settings wherever they lie; runs of older versions still open."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from safetensors import safe_open
from safetensors.torch import save_file

from aa4d.capture.reader import read_capture
from aa4d.errors import InputError
from aa4d.evaluation.evaluate import capture_of, evaluate
from aa4d.files import write_json
from aa4d.methods.model_file import copy_model, load_model
from aa4d.training.trainer import train
from tests.capture.test_content import change_frame, identify
from tests.toy_run import BRIEF, silent


@pytest.fixture
def run(toy_run: Path, tmp_path: Path) -> Path:
    """A copy of a finished run, beside a copy of its capture."""
    shutil.copytree(toy_run.parent / "capture", tmp_path / "capture")
    shutil.copytree(toy_run, tmp_path / "run")
    return tmp_path / "run"


def never(*_: object) -> None:
    raise AssertionError("it was trained again")


def as_of_an_older_version(run: Path) -> None:
    """Settings and model files as they were before there were identities."""
    fingerprint = read_capture(run.parent / "capture").fingerprint
    settings = json.loads((run / "config.json").read_text())
    assert settings["capture_fingerprint"] == fingerprint
    del settings["identity"]
    write_json(run / "config.json", settings)

    def change(header: dict[str, Any]) -> None:
        header.pop("identity", None)
        header["training"]["capture_fingerprint"] = fingerprint

    edit_header(run / "model.safetensors", change)


def edit_header(path: Path, change: Callable[[dict[str, Any]], None]) -> None:
    with safe_open(str(path), framework="pt") as file:
        header = json.loads(file.metadata()["aa4d"])
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    change(header)
    save_file(tensors, str(path), metadata={"aa4d": json.dumps(header)})


def test_a_finished_run_is_returned_for_its_capture_wherever_that_lies(run: Path, tmp_path: Path) -> None:
    shutil.copytree(run.parent / "capture", tmp_path / "moved")
    assert train(read_capture(tmp_path / "moved"), run, BRIEF, never) == run / "model.safetensors"
    change_frame(tmp_path / "moved")
    assert (tmp_path / "moved/capture.json").read_bytes() == (run.parent / "capture/capture.json").read_bytes()
    with pytest.raises(InputError, match="holds a run with another capture"):
        train(read_capture(tmp_path / "moved"), run, BRIEF, never)
    with pytest.raises(InputError, match="is not the capture that"):
        evaluate(run, tmp_path / "moved", silent)


def test_a_run_of_an_older_version_goes_on_with_its_capture_and_with_no_other(run: Path) -> None:
    as_of_an_older_version(run)
    capture = run.parent / "capture"
    assert capture_of(load_model(run / "model.safetensors"), None).folder == capture
    assert train(read_capture(capture), run, BRIEF, never) == run / "model.safetensors"
    assert json.loads((run / "config.json").read_text())["identity"]["kind"] == "run"
    as_of_an_older_version(run)
    identify(capture)  # made anew: by a version that says more in capture.json
    with pytest.raises(InputError, match="holds a run with another capture"):
        train(read_capture(capture), run, BRIEF, never)
    with pytest.raises(InputError, match="is not the capture that"):
        capture_of(load_model(run / "model.safetensors"), None)


def test_a_models_identity_is_of_what_it_draws(run: Path, tmp_path: Path) -> None:
    model, capture = run / "model.safetensors", read_capture(run.parent / "capture")
    identity = load_model(model).identity
    settings = json.loads((run / "config.json").read_text())
    assert identity.made_from["capture"] == capture.identity.digest() == settings["identity"]["made_from"]["capture"]
    assert identity.made_from.keys() == {"capture", "run"}
    (tmp_path / "elsewhere").mkdir()
    copy_model(model, tmp_path / "elsewhere/copy.safetensors")
    edit_header(model, lambda header: header["training"].update(seconds=9.0))
    assert load_model(model).identity == load_model(tmp_path / "elsewhere/copy.safetensors").identity == identity
    edit_header(model, lambda header: header.update(background=[0.0, 0.0, 0.0]))
    assert load_model(model).identity.content != identity.content


def test_an_evaluation_names_its_model_and_its_capture(run: Path) -> None:
    metrics = evaluate(run, None, silent).as_json()
    written = json.loads((run / "metrics.json").read_text())["identity"]
    assert written == metrics["identity"]
    capture, loaded = read_capture(run.parent / "capture"), load_model(run / "model.safetensors")
    assert written["made_from"] == {"model": loaded.identity.digest(), "capture": capture.identity.digest()}


def test_other_settings_are_another_run(run: Path) -> None:
    capture = read_capture(run.parent / "capture")
    with pytest.raises(InputError, match=r"another training\.voxel_px: 3\.0 there, 2\.0 asked for"):
        train(capture, run, replace(BRIEF, voxel_px=2.0), never)


@pytest.mark.parametrize("other", ["seed", "capture", "arithmetic"])
def test_a_checkpoint_of_another_run_is_refused(toy_run: Path, tmp_path: Path, other: str) -> None:
    """Its shapes fit: nothing else would tell."""
    capture, settings = read_capture(toy_run.parent / "capture"), BRIEF
    if other == "capture":
        shutil.copytree(capture.folder, tmp_path / "capture")
        change_frame(tmp_path / "capture")
        identify(tmp_path / "capture")
        capture = read_capture(tmp_path / "capture")
    elif other == "seed":
        settings = replace(BRIEF, seed=BRIEF.seed + 1)
    else:
        settings = replace(BRIEF, arithmetic="bfloat16")
    train(capture, tmp_path / "run", settings, silent)
    checkpoint = tmp_path / "run/checkpoint.safetensors"
    shutil.copy(toy_run / "checkpoint.safetensors", checkpoint)
    (tmp_path / "run/model.safetensors").unlink()
    with pytest.raises(InputError) as caught:
        train(capture, tmp_path / "run", settings, never)
    assert str(caught.value) == (
        f"{checkpoint}: cannot continue from this checkpoint (it is of a run with another capture or other settings); "
        "delete it to start over"
    )


def test_a_checkpoint_of_an_older_version_does_not_say_of_which_run_it_is_and_is_taken(run: Path) -> None:
    path = run / "checkpoint.safetensors"
    with safe_open(str(path), framework="pt") as file:
        state = json.loads(file.metadata()["state"])
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    del state["run"]
    save_file(tensors, str(path), metadata={"state": json.dumps(state)})
    train(read_capture(run.parent / "capture"), run, BRIEF, never)
