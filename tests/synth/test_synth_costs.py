"""cost.json: what was interrupted has cost its seconds too."""

import json
import os
import signal
import sys
import threading
import time
from pathlib import Path

import pytest

from synth.costs import Costs
from synth.errors import InputError
from synth.workers import film_in_workers


def test_seconds_of_an_interrupted_stage_are_kept(tmp_path: Path) -> None:
    costs = Costs(tmp_path / "cost.json")

    def interrupted() -> None:
        with costs.saved(), costs.stage("picture", "000000"), costs.effect("haze"):
            time.sleep(0.05)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    again = Costs(tmp_path / "cost.json")
    assert again.stages["picture"] >= 0.05
    assert again.effects["haze"] >= 0.05
    with again.stage("picture", "000000"):
        time.sleep(0.02)
    assert again.stages["picture"] >= costs.stages["picture"] + 0.02
    assert again.frames["000000"]["picture"] < 0.05  # of the frame: what made it in the end


def test_what_is_refused_writes_no_costs(tmp_path: Path) -> None:
    """The folder is then still free for another plan."""

    def refused() -> None:
        with Costs(tmp_path / "cost.json").saved():
            raise InputError("no such thing")

    with pytest.raises(InputError):
        refused()
    assert list(tmp_path.iterdir()) == []


WORKER = """
import json, sys, time
try:
    time.sleep(60)
finally:
    print("costs " + json.dumps({"stages": {"picture": 7.5}, "effects": {}, "frames": []}), flush=True)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="interrupts itself")
def test_interrupted_workers_say_what_they_have_cost(tmp_path: Path) -> None:
    costs = Costs(tmp_path / "cost.json")
    threading.Timer(1.5, os.kill, (os.getpid(), signal.SIGINT)).start()
    pieces: list[list] = [[1], [2], [3]]
    with pytest.raises(KeyboardInterrupt):
        film_in_workers(lambda _: [sys.executable, "-c", WORKER], pieces, 2, costs, lambda _: None)
    assert json.loads((tmp_path / "cost.json").read_text())["stages"] == {"picture": 15.0}
