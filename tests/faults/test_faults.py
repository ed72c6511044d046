"""A few of the faults of `make faults`: a disk that is full at some writes, and commands that are killed."""

from __future__ import annotations

import os
import random
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.faults.commands import ROOT, Command
from tests.faults.kill import Bench, try_command
from tests.faults.tree import contents, differences, unfinished
from tests.faults.watch import kind_of


def program(module: str, *arguments: str) -> str:
    """What it says, having found nothing wrong."""
    command = [sys.executable, "-W", "ignore", "-m", f"tests.faults.{module}", *arguments]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=1800, check=False)
    if "skipped:" in ended.stdout:
        pytest.skip(ended.stdout.strip())
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


def test_a_disk_that_is_full_while_a_table_is_exported(tmp_path: Path) -> None:
    said = program("full", "export-ply", "--places", "2", "--inputs", str(tmp_path))
    assert "0 wrong, 2 kinds of files cut" in said or "sizes of the disk are tried instead" in said


CARELESS = r"""
import sys
from pathlib import Path
from tests.faults.disk import NoDisk, enter_own_mounts
from tests.faults.full import Bench, Command

careless = '''
import pathlib, sys
try:
    pathlib.Path(sys.argv[1], "first.json").write_text("[1]")
except OSError as error:
    print(error)
    sys.exit(2)
for number in range(2):
    with open(sys.argv[1] + f"/frame{number}.txt", "wb", buffering=0) as file:
        try:
            file.write(bytes(5000))
        except OSError:
            pass
'''
try:
    enter_own_mounts()
except NoDisk as reason:
    sys.exit(f"skipped: {reason}")
command = Command("careless", ("-c", careless, "{disk}"), program=(sys.executable,))
bench = Bench(command, Path(sys.argv[1]), Path(sys.argv[1]))
whole = bench.undisturbed()
print(whole.sizes)
for kind, wrong in bench.cut(whole):
    print(kind, wrong)
"""


def test_a_program_that_takes_a_failed_write_for_done_is_found(tmp_path: Path) -> None:
    command = [sys.executable, "-c", CARELESS, str(tmp_path)]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False)
    if "skipped:" in ended.stderr or "fanotify" in ended.stdout:
        pytest.skip(ended.stderr + ended.stdout)
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.splitlines() == [
        "{'first.json': 3, 'frame*.txt': 5000}",  # one frame stands for all
        "first.json ['half-written: first.json']",
        "    careless, frame*.txt: does without it",
        "frame*.txt ['success, but not all is there: frame0.txt, frame1.txt']",
    ]


FORGETFUL = """
import json, pathlib, sys, time
mark = pathlib.Path(sys.argv[1], "begun.json")
value = [2 if mark.exists() else 1]
mark.write_text("[]")
time.sleep(0.5)
pathlib.Path(sys.argv[1], "result.json").write_text(json.dumps(value))
"""


def test_a_program_that_comes_to_something_else_after_kill_9_is_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = Command("forgetful", ("-c", FORGETFUL, "{disk}"), program=(sys.executable,))
    bench = Bench(command, tmp_path, tmp_path / "work")
    row = try_command(bench, random.Random(2), 3)
    killed = row["killed"]
    assert row["command"] == "forgetful"
    assert killed >= 1
    assert 1 <= row["wrong"] <= 3
    said = capsys.readouterr().out
    assert f"{3 - row['wrong']} times the same 2 files" in said
    assert said.count("heals to something else: result.json") == row["wrong"]


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("eval/.frame_0012.png.k3_9xa2b.part.png", "eval/.frame_*.png.*.part.png"),
        ("tmp/tmpab12_xyz/a.npz", "tmp/tmp*/a.npz"),
        ("tmp/aa4d-synth-dsc_da4s/truth.exr", "tmp/aa*d-synth-*/truth.exr"),
        ("tmp/wtqs5k3w", "tmp/*"),  # in which Python tries whether files can be written
        ("run/.tmpblYUmY", "run/.tmp*"),  # of safetensors
        ("run/.a.usdc.k3_9xa2b.part.Xp1BYL", "run/.a.usdc.*.part.*"),  # of USD
        ("run/history.csv", "run/history.csv"),
        ("train/street-3fa9c1d2e4b5/model.safetensors", "train/street-*/model.safetensors"),
    ],
)
def test_names_of_one_kind_differ_in_numbers_and_what_is_random(name: str, kind: str) -> None:
    assert kind_of(name) == kind


@pytest.mark.slow
@pytest.mark.parametrize("name", ["synth", "capture", "train", "eval", "render", "compare", "extension-usd", "blend"])
def test_a_command_on_full_disks_and_in_folders_that_it_may_not_write(name: str, tmp_path: Path) -> None:
    assert "faults tried, 0 wrong" in program("full", name, "--places", "3", "--inputs", str(tmp_path))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["synth", "capture", "train", "compare", "extension-bake", "export-track"])
def test_a_killed_command_comes_to_the_same_when_run_again(name: str, tmp_path: Path) -> None:
    said = program("kill", name, "--moments", "2", "--inputs", str(tmp_path))
    assert re.search(r"killed [012] times \([012] too late\), 0 wrong, 2 times the same [1-9]\d* files", said), said


def test_what_counts_as_half_written(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text('{"a": 1')
    (tmp_path / "b.png").write_bytes(b"")
    (tmp_path / ".c.npz.x1.part.npz").write_bytes(b"")
    (tmp_path / "d.csv").write_text("step\n1\n")
    (tmp_path / "features.part").mkdir()
    (tmp_path / "features.part" / "e.json").write_text("{")
    (tmp_path / "features.part.json").write_text('{"seconds": 3.5}')
    (tmp_path / "nothing.part.json").write_text('{"seconds": 3.5}')
    left = [".c.npz.x1.part.npz", "a.json", "b.png", "nothing.part.json"]
    assert unfinished(tmp_path) == left, "a step that was stopped works in .part"


def test_times_are_no_difference_and_all_else_is(tmp_path: Path) -> None:
    for number, name in enumerate(("a", "b")):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "metrics.json").write_text(f'{{"psnr": 20.5, "training_seconds": {number}}}')
        (folder / "history.csv").write_text(f"step,loss,seconds\n20,0.5,{number}.5\n")
    a, b = (contents(tmp_path / name) for name in ("a", "b"))
    assert differences(a, b) == []
    (tmp_path / "b" / "history.csv").write_text("step,loss,seconds\n20,0.25,0\n")
    os.remove(tmp_path / "a" / "metrics.json")
    assert differences(contents(tmp_path / "a"), contents(tmp_path / "b")) == ["history.csv", "metrics.json"]
