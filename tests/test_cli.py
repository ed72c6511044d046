"""The command line as a user meets it: help, exit codes, one sentence for bad input."""

import subprocess
import sys
from pathlib import Path

import pytest


def aa4d(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "aa4d.cli", *arguments], capture_output=True, text=True, timeout=120)


@pytest.mark.parametrize(
    "command", [(), ("synth",), ("train",), ("eval",), ("inspect",), ("render",), ("export",), ("demo",)]
)
def test_help_teaches(command: tuple[str, ...]) -> None:
    result = aa4d(*command, "--help")
    assert result.returncode == 0
    assert "usage: aa4d" in result.stdout


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("synth", "absent.toml", "--out", "capture"), "absent.toml: cannot read the scene file"),
        (("train", "absent", "--out", "run"), "absent: no such capture folder"),
        (("eval", "absent"), "no such model file"),
        (("inspect", "absent"), "no such model file"),
        (("render", "absent"), "no such model file"),
        (("export", "absent"), "no such model file"),
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
