"""`aa4d view` as a user meets it."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest
from safetensors.torch import save_file

from aa4d.errors import InputError
from aa4d.methods.model_file import read_tensors
from aa4d.viewer.following import Followed
from aa4d.viewer.run import check_one_capture
from aa4d.viewer.server import serve

pytest.importorskip("viser")
ENVIRONMENT = os.environ | {"OMP_NUM_THREADS": "1"}


def start(*arguments: str) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "aa4d", "view", *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_says_where_it_is_and_who_may_look_and_ends_clean(toy_run: Path, number: signal.Signals) -> None:
    process = start(str(toy_run), "--port", "0")
    assert process.stdout is not None
    line = process.stdout.readline()
    found = re.fullmatch(
        r"viewer: (http://127\.0\.0\.1:\d+) \(this machine alone; --host 0\.0\.0\.0 lets others in\); "
        r"Ctrl-C ends it\n",
        line,
    )
    assert found, line
    with urllib.request.urlopen(found[1], timeout=60) as page:
        assert b"<html" in page.read()
    process.send_signal(number)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0
    assert (out, err) == ("", "")


def test_a_port_that_is_taken_is_one_sentence(toy_run: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        out, err = (process := start(str(toy_run), "--port", str(port))).communicate(timeout=120)
    assert process.returncode == 2
    assert out == ""
    assert err == (
        f"aa4d: 127.0.0.1:{port}: cannot listen there (Address already in use); choose another --port or --host\n"
    )


@pytest.mark.parametrize("port", [-1, 65536, 99999])
def test_a_port_that_none_can_have_is_refused(port: int) -> None:
    with pytest.raises(InputError, match=f"--port {port}: must be from 0 to 65535"):
        serve("127.0.0.1", port)


def test_runs_of_two_captures_are_not_compared(toy_run: Path, tmp_path: Path) -> None:
    header, tensors = read_tensors(toy_run / "model.safetensors")
    header["identity"]["made_from"]["capture"] = "0" * 64
    header["capture"] = None
    save_file(tensors, str(tmp_path / "model.safetensors"), metadata={"aa4d": json.dumps(header)})
    one, other = (Followed(folder, None).load() for folder in (toy_run, tmp_path))
    check_one_capture((one, one))
    with pytest.raises(InputError, match=r"is of another capture than .*run/model\.safetensors"):
        check_one_capture((one, other))
