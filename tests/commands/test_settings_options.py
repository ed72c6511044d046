"""Settings given to commands: by a file, by `--set`, by options; and saved beside the result."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from aa4d.cli import main
from aa4d.methods import METHODS, presets_of
from aa4d.methods.adaanchor4d.settings import PRESETS
from aa4d.methods.settings import MotionSettings
from aa4d.settings.given import Given

BRIEF = """
preset = "quick"
coarse_iterations = 4
fine_iterations = 4
voxel_px = 3
motion = "none"
[densification]
statistics_from = 1
start = 1
interval = 2
until = 4
"""


def aa4d(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    """The exit code of `aa4d` with these arguments."""
    monkeypatch.setattr(sys, "argv", ["aa4d", *map(str, arguments)])
    try:
        main()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 1
    return 0


@pytest.fixture
def brief(tmp_path: Path) -> Path:
    path = tmp_path / "brief.toml"
    path.write_text(BRIEF)
    return path


def test_a_run_is_trained_with_what_is_given_and_its_settings_train_the_same_again(
    toy_capture: Path, brief: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, again = tmp_path / "first", tmp_path / "again"
    given = ["--set", "loss.dssim=0.1", "--set", "rates.planes.initial=0.05", "--seed", "3"]
    assert aa4d(monkeypatch, "train", toy_capture, "--out", first, "--config", brief, *given) == 0
    training = json.loads((first / "config.json").read_text())["training"]
    assert (training["loss"]["dssim"], training["rates"]["planes"], training["seed"]) == (
        0.1,
        {"initial": 0.05, "final": 0.01},
        3,
    )
    assert training["densification"]["until"] == 4
    settings = first / "settings.toml"
    assert Given.by(settings).applied(PRESETS["paper"], chosen=["method"]).loss.dssim == 0.1
    assert aa4d(monkeypatch, "train", toy_capture, "--out", again, "--config", settings) == 0
    for name in ("config.json", "settings.toml"):
        assert (first / name).read_bytes() == (again / name).read_bytes()
    assert tensors(first / "model.safetensors") == tensors(again / "model.safetensors")


def tensors(path: Path) -> dict[str, bytes]:
    from safetensors.numpy import load_file

    return {name: value.tobytes() for name, value in load_file(path).items()}


def config_of(monkeypatch: pytest.MonkeyPatch, capture: Path, *arguments: object) -> Any:
    """The settings that `aa4d train` would train with."""
    seen: list[Any] = []
    monkeypatch.setattr(
        "aa4d.training.trainer.train", lambda _capture, _out, config, _progress, **_: seen.append(config)
    )
    assert aa4d(monkeypatch, "train", capture, "--out", "unused", *arguments) == 0
    return seen[0]


def test_riding_is_the_default_and_is_turned_off_by_file_assignment_or_option(
    toy_capture: Path, brief: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def config(*arguments: object) -> Any:
        return config_of(monkeypatch, toy_capture, *arguments)

    assert config() == replace(PRESETS["quick"], motion=MotionSettings())
    assert config("--motion", "none") == config("--set", "motion=none") == PRESETS["quick"]
    assert config("--config", brief).motion is None
    assert config("--config", brief, "--motion", "tracks").motion == MotionSettings()
    assert config("--config", brief, "--tracks", "pictures").motion == MotionSettings("pictures")
    assert config("--config", brief, "--set", "motion.voxel_px=3").motion == MotionSettings(voxel_px=3.0)
    assert config("--tracks", "boxes", "--set", "motion.voxel_px=3").motion == MotionSettings("boxes", voxel_px=3.0)
    assert config("--no-dlgd", "--set", "model.aggregation=mean").model.dlgd is False
    assert config("--no-dlgd", "--set", "model.aggregation=mean").model.aggregation == "mean"
    assert config("--method", "fourdgs") == presets_of("fourdgs")["quick"]
    assert config("--preset", "paper", "--refine-poses").refine_poses is True
    assert config("--iterations", 80, 300).densification.until == 180


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--motion", "none", "--tracks", "boxes"], '--tracks: motion is given already, as the text "none"'),
        (["--set", "loss.dsim=1"], "--set loss.dsim: unknown key; did you mean loss.dssim?"),
        (["--set", "loss.dssim"], "--set loss.dssim: write KEY=VALUE"),
        (["--config", "absent.toml"], "absent.toml: no such settings file"),
        (["--config", "brief.toml", "--preset", "paper"], "--preset paper: brief.toml: preset says quick; leave one"),
        (["--method", "fourdgs", "--motion", "tracks"], "--motion: motion must be none, for fourdgs has no anchors"),
        (["--method", "fourdgs", "--no-dlgd"], "--no-dlgd: unknown key; allowed here: plane_dim"),
        (["--method", "fourdg"], f"--method fourdg: must be one of {', '.join(METHODS)}; did you mean fourdgs?"),
        (["--seed", "-1"], "--seed: -1 is out of range; it must be a whole number from 0 to 9223372036854775807"),
        (["--set", "seed=1", "--set", "seed=2"], "--set seed: seed is given already, as the number 1"),
    ],
)
def test_what_makes_no_sense_is_one_sentence_and_exit_code_2(
    arguments: list[str],
    says: str,
    brief: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(brief.parent)
    assert aa4d(monkeypatch, "train", "capture", "--out", "run", *arguments) == 2
    said = capsys.readouterr().err
    assert says in said
    assert said.count("\n") == 1
    assert [path.name for path in brief.parent.iterdir()] == ["brief.toml"]


def test_an_experiment_applies_settings_to_every_variant(
    toy_capture: Path, brief: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[Any] = []

    def remember(_experiment: Any, trials: Any, *_: Any) -> Any:
        seen.extend(trials)
        raise KeyboardInterrupt

    monkeypatch.setattr("aa4d.experiments.command.run_experiment", remember)
    arguments = ["--out", tmp_path / "s", "--seeds", 2, "--config", brief, "--set", "loss.dssim=0.3"]
    arguments += ["--set", "seed=5"]
    assert aa4d(monkeypatch, "sweep", "gamma", toy_capture, *arguments) == 130
    assert {trial.settings.warp.gamma for trial in seen} == {0.0, 0.5, 1.0, 2.0}
    assert {(t.settings.loss.dssim, t.settings.fine_iterations, t.settings.motion) for t in seen} == {(0.3, 4, None)}
    assert {trial.settings.seed for trial in seen} == {5, 6}


def test_a_capture_takes_settings_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    seen: list[Any] = []

    def remember(_input: Any, _out: Any, settings: Any, *_: Any) -> Any:
        seen.append(settings)
        raise KeyboardInterrupt

    monkeypatch.setattr("aa4d.capture.make.make_capture", remember)
    file = tmp_path / "c.toml"
    file.write_text('preset = "accurate"\nfov_deg = 60\n[selection]\nrate = 5\n[reconstruction]\nfeatures = 900\n')
    arguments = ["--config", file, "--set", "selection.end_s=9", "--rate", 4, "--threads", 2]
    assert aa4d(monkeypatch, "capture", tmp_path, "--out", tmp_path / "c", *arguments) == 130
    settings = seen[0]
    assert (settings.preset, settings.fov_deg, settings.threads) == ("accurate", 60.0, 2)
    assert (settings.selection.rate, settings.selection.end_s) == (4.0, 9.0)
    assert (settings.reconstruction.features, settings.reconstruction.window) == (900, 8)
    capsys.readouterr()
    assert aa4d(monkeypatch, "capture", tmp_path, "--out", tmp_path / "c", "--set", "reconstruction.feature=1") == 2
    assert "did you mean reconstruction.features?" in capsys.readouterr().err


def test_a_setting_of_motion_that_is_off_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], toy_capture: Path, tmp_path: Path
) -> None:
    given = ("--motion", "none", "--set", "motion.membership=0.2")
    assert aa4d(monkeypatch, "train", toy_capture, "--out", tmp_path / "run", *given) == 2
    assert "--set motion.membership=0.2: has no effect with --motion none" in capsys.readouterr().err
