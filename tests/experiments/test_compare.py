"""`aa4d compare` from the command line to its page."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from aa4d import cli
from aa4d.evaluation.evaluate import evaluate
from aa4d.evaluation.speed import measure_speed
from aa4d.experiments.kinds.evaluate import numbers
from aa4d.experiments.trials import Outcome, Trial
from aa4d.files import claimed, write_json
from aa4d.methods.model_file import load_model


def aa4d(monkeypatch: pytest.MonkeyPatch, *arguments: Any) -> int:
    monkeypatch.setattr(sys, "argv", ["aa4d", *map(str, arguments)])
    try:
        cli.main()
    except SystemExit as end:
        return int(end.code or 0)
    return 0


@pytest.fixture
def outcome(toy_run: Path, monkeypatch: pytest.MonkeyPatch) -> list[Trial]:
    """Instead of trainings: each trial is given the same finished run, but those of 4D-GS, which fail."""
    trained: list[Trial] = []

    def pretend(_experiment: Any, trials: list[Trial], *_: Any) -> Outcome:
        trained.extend(trials)
        rows, failures = [], {}
        for trial in trials:
            if trial.label == "fourdgs":
                failures[trial.name] = f"{trial.out}: training first met NaN"
                continue
            shutil.copytree(toy_run, trial.out, dirs_exist_ok=True)
            metrics = evaluate(trial.out, trial.capture, lambda *_: None).as_json()
            named = {"capture": trial.capture.name, "variant": trial.label, "seed": trial.seed}
            rows.append(named | numbers(metrics))
        return Outcome(rows, failures)

    monkeypatch.setattr("aa4d.experiments.compare.run_experiment", pretend)
    return trained


def test_one_that_fails_is_listed_and_the_others_are_compared(
    outcome: list[Trial],
    toy_run: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out, capture = tmp_path / "out", toy_run.parent / "capture"
    given = ("--methods", "fourdgs,adaanchor4d,adaanchor4d+tracks", "--seeds", 1, "--iterations", 4, 6)
    assert aa4d(monkeypatch, "compare", capture, "--out", out, *given) == 2
    assert "1 of 3 runs failed; first error:" in capsys.readouterr().err
    assert [(t.label, t.settings.fine_iterations, t.settings.motion is None) for t in outcome] == [
        ("fourdgs", 6, True),
        ("adaanchor4d", 6, True),
        ("adaanchor4d+tracks", 6, False),
    ]
    page = (out / "compare.md").read_text()
    assert "| 4D-GS: failed (seed 0) |" in page
    assert "training first met NaN" in page
    assert "4 + 6 iterations of preset `quick`" in page
    document = json.loads((out / "compare.json").read_text())
    assert [row["variant"] for row in document["rows"]] == ["adaanchor4d", "adaanchor4d+tracks"]
    speed = json.loads((out / "capture/adaanchor4d/seed0/speed.json").read_text())
    assert document["rows"][0]["fps"] == speed["fps"], "as timed when nothing trained"
    assert (out / "pareto.png").exists()
    pictures = sorted((out / "pictures").iterdir())
    assert [picture.name for picture in pictures] == ["capture-000000.jpg", "capture-000008.jpg"]
    assert all(f"(pictures/{picture.name})" in page for picture in pictures)
    with Image.open(pictures[0]) as picture:
        assert picture.width > 1000


def test_a_run_is_timed_once(
    outcome: list[Trial], toy_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    del outcome
    capture = toy_run.parent / "capture"
    command = ("compare", capture, "--out", tmp_path / "out", "--methods", "adaanchor4d", "--seeds", 1)
    assert aa4d(monkeypatch, *command) == 0
    before = (tmp_path / "out/capture/adaanchor4d/seed0/speed.json").read_bytes()
    assert aa4d(monkeypatch, *command) == 0
    assert (tmp_path / "out/capture/adaanchor4d/seed0/speed.json").read_bytes() == before


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (("{capture}", "--methods", "fourdg"), "--methods fourdg: must be one of all, .*; did you mean fourdgs?"),
        (("absent",), "absent: no such capture folder"),
        (("{capture}", "--address", "auto"), "--address auto: is of a Ray cluster, and the engine processes uses none"),
        (("{capture}", "--seeds", "0"), "--seeds 0: must be at least 1"),
        (("{capture}", "{capture}"), "two captures are called 'capture'; rename a folder"),
        (("{capture}", "--iterations", "0", "5"), "--iterations 0: must be at least 1"),
        ((), "compare: name at least one capture folder"),
    ],
)
def test_bad_input_is_one_sentence_and_nothing_is_written(
    given: tuple[str, ...],
    says: str,
    toy_run: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    arguments = [text.format(capture=toy_run.parent / "capture") for text in given]
    assert aa4d(monkeypatch, "compare", *arguments, "--out", tmp_path / "out") == 2
    said = capsys.readouterr().err
    assert says.split(".*")[0] in said
    assert says.split(".*")[-1] in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_capture_without_held_out_frames_is_refused(
    toy_capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    index = toy_capture / "capture.json"
    index.write_text(index.read_text().replace('"split": "test"', '"split": "train"'))
    assert aa4d(monkeypatch, "compare", toy_capture, "--out", tmp_path / "out") == 2
    assert 'has no frame to compare on (split "test")' in capsys.readouterr().err


def test_speed_has_a_second_figure_where_a_method_has_a_cache(toy_run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from contextlib import contextmanager

    from aa4d.capture.reader import read_capture

    loaded, capture = load_model(toy_run / "model.safetensors"), read_capture(toy_run.parent / "capture")
    speed = measure_speed(loaded, capture)
    assert (speed.fps_cached, speed.cache) == (None, None)
    opened = []

    @contextmanager
    def cached(self: Any) -> Any:
        opened.append(self)
        yield "what was decoded before"
        opened.append(None)

    monkeypatch.setattr(type(loaded.model), "cached", cached, raising=False)
    speed = measure_speed(loaded, capture)
    assert speed.cache == "what was decoded before"
    assert speed.fps_cached is not None
    assert speed.fps_cached > 0
    assert opened == [loaded.model, None]


def test_two_commands_do_not_work_in_one_folder(
    toy_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_json(tmp_path / "experiment.json", {"experiment": "compare"})
    with claimed(tmp_path, "running an experiment"):
        assert aa4d(monkeypatch, "compare", toy_run.parent / "capture", "--out", tmp_path) == 2
    assert "another process is running an experiment there; wait for it" in capsys.readouterr().err


@pytest.mark.slow
def test_killed_in_the_middle_the_same_command_continues(toy_capture: Path, tmp_path: Path) -> None:
    out, environment = tmp_path / "out", os.environ | {"OMP_NUM_THREADS": "1"}
    options = ["--methods", "fourdgs,adaanchor4d", "--seeds", "1", "--jobs", "2", "--iterations", "20", "200"]
    command = [sys.executable, "-m", "aa4d.cli", "compare", str(toy_capture), "--out", str(out), *options]
    process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        deadline = time.monotonic() + 600
        while not (out / "capture/adaanchor4d/seed0/coarse.safetensors").exists():
            assert time.monotonic() < deadline
            time.sleep(0.05)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    result = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600)
    assert result.returncode == 0, result.stderr
    assert len(json.loads((out / "compare.json").read_text())["rows"]) == 2
