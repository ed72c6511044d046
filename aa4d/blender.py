"""Running the two Blender rooms, synth/ and addon/, as programs of their own: `aa4d` itself never imports bpy."""

from __future__ import annotations

import importlib.util
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType

from aa4d.errors import InputError

REPOSITORY = Path(__file__).resolve().parent.parent


def script(relative: str) -> Path:
    """A script of the repository that this package is installed from."""
    path = REPOSITORY / relative
    if not path.exists():
        raise InputError(f"{path}: not found; install aa4d from a checkout of the repository (pip install -e .)")
    return path


def blender_is_here() -> bool:
    """Tell whether `run_in_blender` would find one."""
    return importlib.util.find_spec("bpy") is not None or shutil.which("blender") is not None


def run_in_blender(relative: str, *arguments: str, hear: Callable[[str], None] | None = None) -> int:
    """Run a script with the bpy module where it is installed, else in the Blender on PATH; returns its exit code.

    The module comes first because its version is the one that constraints.txt pins and the tests run with.

    Args:
        hear: is given each line that the script prints, instead of this program's output.
    """
    path = str(script(relative))
    if importlib.util.find_spec("bpy") is not None:
        return run_forwarding_interrupts([sys.executable, path, *arguments], hear)
    blender = shutil.which("blender")
    if blender is not None:
        return run_forwarding_interrupts([blender, "-b", "-P", path, "--", *arguments], hear)
    raise InputError(
        'Blender is not here; put `blender` on PATH, or install the module with pip install -e ".[blender]"'
    )


def run_forwarding_interrupts(command: list[str], hear: Callable[[str], None] | None = None) -> int:
    """Run a child in a process group of its own and hand it each Ctrl-C once, so that it can end in its own time.

    The environment names this process to it, so that a renderer ends when this one is killed (synth/parent.py).
    """
    child = subprocess.Popen(
        command,
        process_group=0,
        env={**os.environ, "AA4D_PARENT": str(os.getpid())},
        stdout=None if hear is None else subprocess.PIPE,
        stderr=None if hear is None else subprocess.STDOUT,
        text=True,
        errors="replace",
    )

    def forward(number: int, _frame: FrameType | None) -> None:
        child.send_signal(number)

    before = {number: signal.signal(number, forward) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        if hear is not None and child.stdout is not None:
            for line in child.stdout:
                hear(line.rstrip())
        return child.wait()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
