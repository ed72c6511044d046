"""The parts of the check, one after another, each in a process and a time of its own; the JSON is whole after each.

It imports nothing of the project, so that it has something to say where that cannot be imported.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from tests.device.asked import Asked

# In order, and the most seconds that each may take on a GPU, which is borrowed by the minute.
PARTS = {"environment": 40, "build": 240, "parity": 60, "kernels": 90, "bench": 110, "train": 420}
REPORT_S = 10.0  # of a part's time that is kept for writing down what it found
TAIL = 4000  # characters of a part's output that are kept where it fails


def run_part(part: str, asked: Asked, limit_s: float) -> dict[str, Any]:
    """Status, seconds, and what the part found until it was done, failed or was killed."""
    work = Path(asked.work)
    found_path, log_path = work / f"{part}.json", work / f"{part}.log"
    found_path.unlink(missing_ok=True)
    asked = replace(asked, ends=time.time() + max(limit_s - REPORT_S, 1.0))
    command = [sys.executable, "-m", "tests.device.one_part", part, str(found_path), asked.as_text()]
    site = str(work / "site")  # what the part "build" installs
    paths = [site, *filter(None, [os.environ.get("PYTHONPATH")])]
    started = time.monotonic()
    with log_path.open("w") as log:
        # A group of its own, so that what it started is killed with it.
        process = subprocess.Popen(
            command,
            stdout=log,
            stderr=subprocess.STDOUT,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
            start_new_session=True,
        )
        try:
            status = "failed" if process.wait(limit_s) else "done"
        except subprocess.TimeoutExpired:
            status = "out of time"
        except KeyboardInterrupt:
            status = "stopped"
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
    row: dict[str, Any] = {"status": status, "seconds": round(time.monotonic() - started, 1)}
    row["found"] = json.loads(found_path.read_text()) if found_path.exists() else {}
    if status != "done":
        row["output"] = log_path.read_text(errors="replace")[-TAIL:]
    return row


def check(asked: Asked, out: Path, parts: Sequence[str], budget_s: float, again: bool) -> dict[str, Any]:
    """Run the parts that `out` does not have yet, and write it after each."""
    result: dict[str, Any] = {"device": asked.device, "tiny": asked.is_tiny, "parts": {}}
    if out.exists():
        before = json.loads(out.read_text())
        if all(before.get(key) == result[key] for key in ("device", "tiny")):
            result = before
    ends = time.monotonic() + budget_s
    for part in parts:
        if not again and result["parts"].get(part, {}).get("status") == "done":
            print(f"{part}: done before", flush=True)
            continue
        left = ends - time.monotonic()
        if left <= REPORT_S:
            print(f"{part}: no time left", flush=True)
            result["parts"].setdefault(part, {"status": "no time left"})
        else:
            limit_s = min(PARTS[part], left) if asked.device == "cuda" else left
            row = result["parts"][part] = run_part(part, asked, limit_s)
            print(f"{part}: {row['status']} in {row['seconds']} s", flush=True)
            if row["status"] != "done":
                print(row["found"].get("traceback", row["output"]), flush=True)
        beside = out.with_suffix(".part")
        beside.write_text(json.dumps(result, indent=1) + "\n")
        beside.replace(out)
        if result["parts"][part]["status"] == "stopped":
            break
    return result


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.device", description=__doc__)
    parser.add_argument("--device", choices=("cuda", "cpu"), default="cuda", help="cpu rehearses every part")
    parser.add_argument("--out", type=Path, required=True, help="the JSON; parts that it has as done are not repeated")
    parser.add_argument("--parts", default=",".join(PARTS), help="which, with commas; the default is all, in order")
    parser.add_argument("--budget-s", type=float, default=600, help="seconds for all of them together")
    parser.add_argument("--capture", type=Path, help="a capture folder to train on")
    parser.add_argument("--model", type=Path, help="a trained model of that capture, to compare rasterisers on")
    parser.add_argument("--carried", type=Path, help="folder with gsplat's source archive, or its wheel")
    parser.add_argument("--work", type=Path, help="folder for what is built and trained; the default is beside --out")
    parser.add_argument("--tiny", action="store_true", help="the smallest sizes that run every line")
    parser.add_argument("--again", action="store_true", help="repeat parts that are done")
    given = parser.parse_args(arguments)
    parts = given.parts.split(",")
    if unknown := [part for part in parts if part not in PARTS]:
        parser.error(f"--parts: {unknown[0]!r} is unknown; choose of {', '.join(PARTS)}")
    for name in ("capture", "model", "carried"):
        path = getattr(given, name)
        if path is not None and not path.exists():
            parser.error(f"--{name}: there is no {path}")
    if not given.out.parent.is_dir():
        parser.error(f"--out: there is no folder {given.out.parent}")
    work = given.work or given.out.with_name(given.out.stem + "-work")
    work.mkdir(parents=True, exist_ok=True)
    texts = {n: None if getattr(given, n) is None else str(getattr(given, n).resolve()) for n in ("capture", "model")}
    carried = None if given.carried is None else str(given.carried.resolve())
    asked = Asked(given.device, str(work.resolve()), carried=carried, is_tiny=given.tiny, **texts)
    result = check(asked, given.out, parts, given.budget_s, given.again)
    return 0 if all(result["parts"][part]["status"] == "done" for part in parts) else 1


if __name__ == "__main__":
    sys.exit(main())
