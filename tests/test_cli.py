"""The command line as a user meets it: help, exit codes, one sentence for bad input."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from aa4d.cli import COMMANDS


def aa4d(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "aa4d.cli", *arguments], capture_output=True, text=True, timeout=120)


@pytest.mark.parametrize("command", [(), *((name,) for name in COMMANDS)])
def test_help_teaches(command: tuple[str, ...]) -> None:
    result = aa4d(*command, "--help")
    assert result.returncode == 0
    assert "usage: aa4d" in result.stdout
    assert "{None}" not in result.stdout
    assert "(default: )" not in result.stdout


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("synth", "absent.toml", "--out", "capture"), "absent.toml: cannot read the scene file"),
        (("capture", "", "--out", "capture"), "an argument is empty; name what it should be"),
        (("capture", "absent", "--out="), "an argument is empty; name what it should be"),
        (("train", "absent", "--out", "run"), "absent: no such capture folder"),
        (("train", __file__, "--out", "run"), "test_cli.py: is a file; name the folder of the capture"),
        (("eval", "absent"), "no such model file"),
        (("inspect", "absent"), "no such model file"),
        (("render", "absent"), "no such model file"),
        (("report", "absent"), "absent: no such folder; name a run, an experiment or a comparison"),
        (("report", __file__), "test_cli.py: is a file; name the folder that holds it"),
        (("view", "absent"), "absent: no such folder; name that of a run"),
        (("view",), "name at least one run"),
        (("export", "absent"), "no such model file"),
        (("render", __file__), "test_cli.py: is a file; name the folder of the run"),
        (("train", "absent", "--out", "run", "--seed", str(2**63)), "--seed: 9223372036854775808 is out of range"),
        (("bench", "raster", "--json", "absent/rows.json"), "--json absent/rows.json: there is no folder absent"),
        (("trian", "capture"), "trian: no such command; it must be one of synth, "),
        (("train", "absent", "--out", "run", "--config", "a="), "a=: no such settings file"),
        (("train", "absent", "--out", "run", "--config=a="), "a=: no such settings file"),
        (("synth", "verfy", "capture"), "aa4d synth verfy: neither a scene file nor a command; did you mean verify?"),
        (("synth", "sheet", "--out", "sheet"), "aa4d synth sheet: name at least one scene file"),
        (("synth", "render", "absent.toml", "--out", "capture"), "absent.toml: cannot read the scene file"),
        (("demo", "absent.toml", "--out", "demo"), "absent.toml: no such scene file"),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2(
    arguments: tuple[str, ...], says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = aa4d(*arguments)
    assert result.returncode == 2
    assert says in result.stderr
    assert result.stderr.count("\n") == 1
    assert "Traceback" not in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_what_the_system_refuses_is_one_sentence_too(toy_run: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    shutil.copytree(toy_run, run)
    (run / "metrics.json").unlink(missing_ok=True)
    (run / "metrics.json").mkdir()
    result = aa4d("eval", str(run), "--capture", str(toy_run.parent / "capture"))
    assert result.returncode == 2
    assert "metrics.json: Is a directory" in result.stderr
    assert "Traceback" not in result.stderr


def test_brackets_in_a_path_are_printed_as_they_are(toy_run: Path, tmp_path: Path) -> None:
    run = tmp_path / "[red]run[" / "b]"
    shutil.copytree(toy_run, run)
    result = aa4d("render", str(run), "--time", "0.5", "--frames", "1")
    assert f"renders: {run / 'renders'}" in result.stdout


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--part", "rastre"), "--part rastre: must be one of traffic, "),
        (("--budget", "-1"), "--budget -1.0: must be from 0"),
        (("--write", "absent/table.md"), "--write absent/table.md: there is no folder absent"),
        (("--write", "."), "--write .: is a folder; name a file, for instance hard-cases.md"),
        (("--part", "dlgd", "--write", __file__), "is there, and would hold dlgd alone; name a new file"),
        (("--write", __file__), "is there and no page of hard cases"),
        (("--part", "dlgd", "--budget", "1"), "--budget: dlgd has no search; leave it out, or name one of raster, "),
    ],
)
def test_stress_refuses_what_it_does_not_know(arguments: tuple[str, ...], says: str) -> None:
    result = aa4d("stress", *arguments)
    assert result.returncode == 2
    assert says in result.stderr
    assert result.stderr.count("\n") == 1


def test_stress_runs_a_part_and_writes_its_table(tmp_path: Path) -> None:
    result = aa4d("stress", "--part", "densification", "--write", str(tmp_path / "table.md"))
    assert result.returncode == 0, result.stderr
    assert "cases, 0 failed" in result.stdout
    rows = [line for line in (tmp_path / "table.md").read_text().splitlines() if line.startswith("| ")]
    assert len(rows) == 1 + result.stdout.count("densification: ")


def test_a_name_that_the_terminal_cannot_show_is_shown_by_its_codes(tmp_path: Path) -> None:
    scene = Path(__file__).parents[1] / "scenes" / "tiny.toml"
    text = f'title = "T"\nscenes = ["{scene.as_posix()}"]\n[variants."grün"]\n'
    (tmp_path / "e.toml").write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "aa4d.cli", "experiment", "e.toml", "--out", "out", "--plan"]
    environment = os.environ | {"PYTHONIOENCODING": "ascii"}
    result = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300)
    assert result.returncode == 0, result.stderr
    assert r"train tiny, gr\xfcn, seed 0: to do" in result.stdout
