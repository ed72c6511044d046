"""Ctrl-C at the moments at which nothing has begun yet."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

SLOW_LIBRARY = """
import time
try:
    print("importing", flush=True)
    time.sleep(60)
except BaseException:
    raise ImportError("Cannot import the C++ backend")
"""


@pytest.mark.parametrize("is_importing", [True, False])
def test_ctrl_c_while_modules_are_imported_ends_quietly(tmp_path: Path, is_importing: bool) -> None:
    (tmp_path / "library.py").write_text(SLOW_LIBRARY)
    work = "import library" if is_importing else "import time; print('working', flush=True); time.sleep(60)"
    program = (
        "from aa4d.interrupts import end_quietly_while_importing\n"
        "end_quietly_while_importing()\n"
        f"try:\n    {work}\n"
        "except KeyboardInterrupt:\n    print('saved', flush=True)\n"
    )
    command = [sys.executable, "-c", program]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    process.stdout.readline()
    process.send_signal(signal.SIGINT)
    said, complaint = process.communicate(timeout=60)
    if is_importing:
        assert (process.returncode, said, complaint) == (130, "", "aa4d: stopped\n")
    else:
        assert (process.returncode, said, complaint) == (0, "saved\n", "")
