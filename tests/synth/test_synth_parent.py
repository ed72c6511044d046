"""A renderer and its workers end with whoever started them, also when that one is killed."""

import importlib.util
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from synth import parent

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="sends SIGKILL")

CHILD = """
import sys, time
sys.path.insert(0, {root!r})
from synth import parent
if {watch}:
    parent._ask_the_kernel = lambda: False
parent.end_with_parent()
print("here", flush=True)
time.sleep(60)
"""
STARTER = """
import subprocess, sys, time
sys.path.insert(0, {root!r})
from synth.parent import environment_of_child
child = subprocess.Popen([sys.executable, "-c", {child!r}], stdout=subprocess.PIPE, env=environment_of_child())
child.stdout.readline()
print(child.pid, flush=True)
time.sleep(60)
"""


def gone(processes: set[int], within_s: float) -> bool:
    """Whether all of them end (or are zombies) in time."""
    deadline = time.monotonic() + within_s
    while time.monotonic() < deadline:
        if not any(lives(process) for process in processes):
            return True
        time.sleep(0.05)
    return False


def lives(process: int) -> bool:
    try:
        state = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


@pytest.mark.skipif(not Path("/proc/self/stat").is_file(), reason="reads /proc")
@pytest.mark.parametrize("watch", [False, True], ids=["kernel", "thread"])
def test_a_child_ends_with_its_killed_starter(watch: bool) -> None:
    child = CHILD.format(root=str(ROOT), watch=watch)
    starter = subprocess.Popen([sys.executable, "-c", STARTER.format(root=str(ROOT), child=child)],
                               stdout=subprocess.PIPE, text=True)  # fmt: skip
    assert starter.stdout is not None
    started = int(starter.stdout.readline())
    assert lives(started)
    starter.kill()
    starter.wait()
    assert gone({started}, 10.0)


def test_without_a_starter_nothing_happens(monkeypatch: pytest.MonkeyPatch) -> None:
    """From a shell that closes, `nohup` goes on as it should."""
    monkeypatch.delenv(parent.PARENT, raising=False)
    monkeypatch.setattr(parent, "_ask_the_kernel", lambda: pytest.fail("asked"))
    parent.end_with_parent()


def test_a_starter_that_is_gone_already_ends_the_child() -> None:
    process = subprocess.Popen([sys.executable, "-c", "pass"])
    process.wait()
    code = f"import sys; sys.path.insert(0, {str(ROOT)!r}); from synth import parent; parent.end_with_parent()"
    environment = {**os.environ, parent.PARENT: str(process.pid)}
    command = [sys.executable, "-c", f"{code}; import time; time.sleep(60)"]
    assert subprocess.run(command, env=environment, timeout=30, check=False).returncode == 1


@pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs the bpy module")
@pytest.mark.skipif(not Path("/proc/self/stat").is_file(), reason="reads /proc")
def test_killing_the_launcher_ends_renderer_and_workers(tiny_scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    launcher = subprocess.Popen([sys.executable, "-m", "aa4d", "synth", str(tiny_scene), "--out", str(out),
                                 "--workers", "2"], stdout=subprocess.DEVNULL, cwd=ROOT)  # fmt: skip
    deadline = time.monotonic() + 120
    while not list(out.glob("truth/*.npz")) and launcher.poll() is None:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    started = working_on(out) - {launcher.pid}
    assert len(started) == 3
    os.kill(launcher.pid, signal.SIGKILL)
    launcher.wait()
    assert gone(started, 10.0)


def working_on(out: Path) -> set[int]:
    """Processes with the folder on their command line."""
    found = set()
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            if str(out).encode() in path.read_bytes().split(b"\0"):
                found.add(int(path.parent.name))
        except OSError:
            continue
    return found
