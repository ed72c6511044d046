"""`aa4d experiment` from the command line to its tables, on the toy capture."""

import importlib.util
import json
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest

from aa4d import cli
from aa4d.errors import InputError
from aa4d.files import claimed
from aa4d.graph.call import Call
from aa4d.graph.kinds import Kind

SCENES = Path(__file__).resolve().parents[2] / "scenes"
TEXT = """
title = "Two of them"
scenes = ["capture"]
iterations = [4, 4]
settings.voxel_px = 3.0
[variants.product]
aggregation = "product"
[variants.full]
"""


@pytest.fixture
def file(toy_capture: Path) -> Path:
    path = toy_capture.parent / "two.toml"
    path.write_text(TEXT)
    return path


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Instead of training and scoring: a file each, and made-up scores. The names of what was done."""
    done: list[str] = []

    def train(call: Call) -> dict[str, Any]:
        done.append(call.task.title)
        if call.task.settings.settings.seed == 13:
            raise InputError("training first met NaN in the loss")
        (call.folder / "model").write_text(call.task.name)
        return {}

    def evaluate(call: Call) -> dict[str, Any]:
        done.append(call.task.title)
        (call.folder / "metrics").write_text("")
        return {"psnr": 20.0 + len((call.needs[0].folder / "model").read_text()), "fps": 1}

    monkeypatch.setattr("aa4d.experiments.kinds.train.KIND", Kind(train))
    monkeypatch.setattr("aa4d.experiments.kinds.evaluate.KIND", Kind(evaluate))
    return done


def aa4d(monkeypatch: pytest.MonkeyPatch, *arguments: Any) -> int:
    monkeypatch.setattr(sys, "argv", ["aa4d", "experiment", *map(str, arguments)])
    try:
        cli.main()
    except SystemExit as end:
        return int(end.code or 0)
    return 0


def test_runs_are_trained_scored_and_tabulated_and_stay(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    command = (file, "--out", out, "--engine", "inline")
    assert aa4d(monkeypatch, *command) == 0
    said = capsys.readouterr().out
    assert "Two of them: capture" in said
    assert "5/5  tabulate two" in said
    events = [json.loads(line)["event"] for line in (out / "events.jsonl").read_text().splitlines()]
    assert events.count("started") == events.count("finished") == 5
    table = (out / "tables/table.md").read_text()
    assert "| capture | product | 1 |" in table
    runs = sorted(path.name for path in (out / "train").iterdir() if path.is_dir())
    assert [name.rpartition("-")[0] for name in runs] == ["capture-full-seed-0", "capture-product-seed-0"]
    assert (out / "train" / runs[0] / "model.safetensors").exists()
    assert not (out / "train" / runs[0] / "metrics.json").exists(), "what is finished is written to no more"
    scored = next((out / "evaluate").glob("capture-full-*/metrics.json"))
    row = next(line for line in (out / "tables/rows.csv").read_text().splitlines() if ",full," in line)
    assert f"{json.loads(scored.read_text())['psnr']}" in row
    before = {path: path.stat().st_mtime_ns for path in (out / "train").rglob("*") if path.is_file()}
    assert aa4d(monkeypatch, *command) == 0
    assert "5 of 5 tasks done before" in capsys.readouterr().out
    assert {path: path.stat().st_mtime_ns for path in (out / "train").rglob("*") if path.is_file()} == before


def test_one_run_that_fails_is_listed_and_the_others_are_tabulated(
    file: Path, quick: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file.write_text(TEXT.replace("[settings]", "").replace("iterations", "seeds = [0, 13]\niterations"))
    out = tmp_path / "out"
    assert aa4d(monkeypatch, file, "--out", out, "--engine", "inline") == 2
    captured = capsys.readouterr()
    assert "2 of 9 tasks failed, 2 that need them were not tried; first: train capture, product, seed" in captured.err
    assert captured.err.count("\n") == 1
    assert (out / "tables/rows.csv").read_text().count("\n") == 3
    failed = (out / "tables/failed.md").read_text().splitlines()
    assert failed[0] == (
        "- capture, product, seed 13: not tried, for train capture, product, seed 13 failed: training first met NaN in "
        "the loss"
    )
    again = [*quick]
    assert aa4d(monkeypatch, file, "--out", out, "--engine", "inline") == 2
    assert [name for name in quick[len(again) :] if "13" not in name] == [], "only what failed is tried again"


def test_a_plan_shows_what_would_be_run_and_how_long_and_writes_nothing(
    file: Path, quick: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out, other = tmp_path / "out", tmp_path / "other"
    assert aa4d(monkeypatch, file, "--out", out, "--plan") == 0
    assert "5 of 5 tasks to do, 1 at a time; how long they take is not known" in capsys.readouterr().out
    assert not out.exists()
    assert aa4d(monkeypatch, file, "--out", other, "--engine", "inline") == 0
    record = next((other / "train").glob("capture-full-*.json"))
    assert json.loads(record.read_text())["seconds"] >= 0
    quick.clear()
    capsys.readouterr()
    assert aa4d(monkeypatch, file, "--out", out, "--plan", "--costs", other, "--jobs", 2) == 0
    assert "5 of 5 tasks to do, 2 at a time: about " in capsys.readouterr().out
    file.write_text(TEXT + "modules = []\n")
    assert aa4d(monkeypatch, file, "--out", other, "--plan") == 0
    said = capsys.readouterr().out
    assert "train capture, product, seed 0: done\n" in said
    assert "train capture, full, seed 0: to do, about " in said
    assert "3 of 5 tasks to do" in said
    assert quick == []


def test_parts_that_are_run_one_by_one_are_one_experiment(
    file: Path, quick: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    for part in ("1/2", "2/2"):
        assert aa4d(monkeypatch, file, "--out", out, "--engine", "inline", "--part", part) == 0
        assert not (out / "tables").exists()
    assert len(quick) == 4
    assert aa4d(monkeypatch, file, "--out", out, "--engine", "inline") == 0
    assert len(quick) == 4
    assert (out / "tables/table.md").exists()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--part", "0/2"), "--part 0/2: write which of how many, from 1 on, for instance 3/20"),
        (("--part", "three"), "--part three: write which of how many"),
        (("--jobs", "0"), "--jobs 0: must be at least 1"),
        (("--tensorboard",), "--tensorboard: needs the package tensorboard; pip install tensorboard"),
        (("--engine", "inlin"), "--engine inlin: must be one of inline, processes, ray; did you mean inline?"),
        (("--engine", "ray"), "--engine ray: say which cluster with --address HOST:PORT"),
        (("--engine", "inline", "--jobs", "2"), "--jobs 2: the engine inline does one task at a time"),
        (("--engine", "inline", "--jobs", "2", "--plan"), "--jobs 2: the engine inline does one task at a time"),
        (
            ("--address", "auto"),
            "--address auto: is of a Ray cluster, and the engine processes uses none; add --engine",
        ),
        (("--address", "auto", "--plan"), "--address auto: is of a Ray cluster, and the engine processes uses none"),
        (("--costs", "nowhere"), "--costs nowhere: no such folder; name one that `aa4d experiment` or `aa4d cost`"),
        (("--costs", "nowhere", "--plan"), "--costs nowhere: no such folder"),
    ],
)
def test_bad_input_is_one_sentence_and_nothing_is_written(
    file: Path,
    tmp_path: Path,
    arguments: tuple[str, ...],
    says: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if "ray" in arguments:
        pytest.importorskip("ray")
    find = importlib.util.find_spec
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == "tensorboard" else find(name))
    assert aa4d(monkeypatch, file, "--out", tmp_path / "out", *arguments) == 2
    said = capsys.readouterr().err
    assert says in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()


KNOB = """
title = "Rates"
scenes = ["tiny.toml"]
[variants.full]
[axis]
label = "frames per second"
values = [12, 24]
[axis.scene.time]
fps = [12, 24]
"""


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("fps =", "fpss ="), "tiny.toml, as tiny-12: time.fpss: unknown key; did you mean 'fps'?"),
        (("[12, 24]\n[axis", "[12, 5000]\n[axis"), None),
        (("fps = [12, 24]", "fps = [12, 5000]"), "tiny.toml, as tiny-24: time.fps: 5000 is out of range, it must be a"),
        (("[axis.scene.time]\nfps", "[axis.scene.effects.haze]\nvisibility"), "effects.haze.visibility: unknown key"),
        (("[axis]", "[scene.camera]\nwidth = 64\n[axis]"), "camera.width: unknown key; did you mean 'width_px'?"),
    ],
)
def test_a_scene_that_the_renderer_would_refuse_is_refused_before_anything_is_written(
    change: tuple[str, str],
    says: str | None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    shutil.copyfile(SCENES / "tiny.toml", tmp_path / "tiny.toml")
    file = tmp_path / "rates.toml"
    assert change[0] in KNOB
    file.write_text(KNOB.replace(*change))
    if says is None:
        assert aa4d(monkeypatch, file, "--out", tmp_path / "out", "--plan") == 0
        return
    for plan in ((), ("--plan",)):
        assert aa4d(monkeypatch, file, "--out", tmp_path / "out", *plan) == 2
        said = capsys.readouterr().err
        assert said.startswith(f"aa4d: {file}: ")
        assert says in said
        assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_plan_is_of_a_folder_that_the_run_would_take(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "letter.txt").write_text("dear")
    said = []
    for plan in ((), ("--plan",)):
        assert aa4d(monkeypatch, file, "--out", tmp_path, "--engine", "inline", *plan) == 2
        said.append(capsys.readouterr().err)
    assert "not empty and not an experiment; choose a new folder with --out" in said[0]
    assert said[0] == said[1]


def test_costs_of_a_folder_in_which_nothing_was_measured_are_said_to_be_none(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert aa4d(monkeypatch, file, "--out", tmp_path / "out", "--plan", "--costs", tmp_path) == 0
    assert f"--costs {tmp_path}: holds nothing that was measured\n" in capsys.readouterr().out


def test_two_runs_or_two_experiments_in_one_folder_are_refused(
    file: Path, quick: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert aa4d(monkeypatch, file, "--out", out, "--engine", "inline") == 0
    with claimed(out, "running"):
        assert aa4d(monkeypatch, file, "--out", out, "--engine", "inline") == 2
    assert "another process is running an experiment there; wait for it" in capsys.readouterr().err
    other = file.with_name("other.toml")
    shutil.copyfile(file, other)
    assert aa4d(monkeypatch, other, "--out", out, "--engine", "inline") == 2
    assert "holds an experiment with other settings; choose another --out" in capsys.readouterr().err
    assert len(quick) == 4
