"""Stages in a process of their own: what they raise, how they are stopped, and what is said when they die."""

import os
import shutil
import signal
import threading
import time
from collections import namedtuple
from pathlib import Path

import pytest

from aa4d.capture.apart import apart
from aa4d.errors import InputError

Usage = namedtuple("Usage", "total used free")


def complain(path: Path) -> None:
    os.write(2, b"*** Aborted; stack trace:\n")
    path.write_text(str(os.getpid()))
    os.abort()


def begin(path: Path) -> None:
    path.mkdir()
    time.sleep(60)


def test_stages_run_one_after_the_other_and_raise_what_they_raise(tmp_path: Path) -> None:
    with apart(tmp_path) as run:
        run(os.mkdir, tmp_path / "a")
        with pytest.raises(FileExistsError):
            run(os.mkdir, path=tmp_path / "a")
        run(os.rename, tmp_path / "a", tmp_path / "b")
    assert (tmp_path / "b").is_dir()


def test_a_stage_that_kills_its_process_is_a_sentence(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    says = r"COLMAP died, with \d+ MiB free on the disk; the same command goes on"
    with apart(tmp_path) as run, pytest.raises(InputError, match=says):
        run(complain, tmp_path / "pid")
    assert capfd.readouterr() == ("", ""), "its stack trace is for its developers"


@pytest.mark.parametrize("stage", [(complain,), (time.sleep, 60)])
def test_on_a_full_disk_that_is_what_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stage: tuple[object, ...]
) -> None:
    """The stage dies, or waits for ever for a database that it cannot write."""
    free = iter([1 << 30])
    monkeypatch.setattr(shutil, "disk_usage", lambda _: Usage(1 << 40, 0, next(free, 0)))
    arguments = (tmp_path / "pid",) if stage[0] is complain else stage[1:]
    started = time.monotonic()
    with pytest.raises(OSError, match="less than 4 MiB are free"), apart(tmp_path) as run:
        run(stage[0], *arguments)
    assert time.monotonic() - started < 50


def test_ctrl_c_ends_the_stage(tmp_path: Path) -> None:
    def press() -> None:
        while not (tmp_path / "begun").exists():
            time.sleep(0.05)
        os.kill(os.getpid(), signal.SIGINT)

    started = time.monotonic()
    with apart(tmp_path) as run:
        threading.Thread(target=press).start()
        with pytest.raises(KeyboardInterrupt):
            run(begin, tmp_path / "begun")
    assert time.monotonic() - started < 50
