"""What the extension's builder says when Blender's tool fails."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from addon import build_extension

CASES = {
    "Traceback (most recent call last):\n  File x\nOSError: [Errno 28] No space left on device\n": (
        "OSError: [Errno 28] No space left on device\n"
    ),
    "FATAL_ERROR: manifest\nid: missing\n": "FATAL_ERROR: manifest\nid: missing\n",
}


@pytest.mark.parametrize("said", CASES)
def test_its_message_is_told_without_its_traceback(
    said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(_: Path) -> None:
        raise subprocess.CalledProcessError(1, ["blender"], said)

    monkeypatch.setattr(build_extension, "build", fail)
    monkeypatch.setattr(sys, "argv", ["build_extension.py", str(tmp_path / "a.zip")])
    assert build_extension.main() == 2
    assert capsys.readouterr().err == CASES[said]
