"""`python -m tests.fuzz`: thousands of damaged files for every reader, in a process with bounded memory.

A process that dies (of a signal, or out of memory in native code) is a defect of the file that it read last, and the
next one goes on behind it.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import sys
import time
from multiprocessing.connection import Connection
from pathlib import Path

from aa4d.files import write_json
from tests.fuzz.attack import Defect, attack
from tests.fuzz.readers import READERS, Reader

MOST_MEMORY = 1 << 30  # bytes, beyond what the process has when it begins
SILENT_S = 60.0  # after which native code, which does not hear the clock, counts as hanging
BATCH = 250  # files, after which the clock is looked at


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=10_000, help="damaged files for each reader")
    parser.add_argument("--budget", type=float, default=1800, help="seconds for all of them together")
    parser.add_argument("--reader", choices=[r.name for r in READERS], help="this one alone")
    parser.add_argument("--seed", type=int, default=0, help="of the first file")
    parser.add_argument("--json", type=Path, help="file for the table")
    given = parser.parse_args()
    chosen = [r for r in READERS if given.reader in (None, r.name)]
    rows = []
    for reader in chosen:
        begin = time.monotonic()
        end, seed, last = begin + given.budget / len(chosen), given.seed, given.seed + given.count
        kinds: dict[str, Defect] = {}
        while seed < last and time.monotonic() < end:
            batch = range(seed, min(seed + BATCH, last))
            defects, seed = run_apart(reader, batch)
            for defect in defects:
                kinds.setdefault(defect.what[:60], defect)
            seed = max(seed, batch.start + 1)
        seconds = time.monotonic() - begin
        print(
            f"{reader.name:20} {seed - given.seed:6} files  {seconds:6.1f} s  {len(kinds)} kinds of defect", flush=True
        )
        for defect in kinds.values():
            print(f"    seed {defect.seed}: {defect.what}", flush=True)
        rows.append({"reader": reader.name, "files": seed - given.seed, "kinds": len(kinds)})
        if given.json is not None:
            write_json(given.json, {"rows": rows})
    sys.exit(1 if any(row["kinds"] for row in rows) else 0)


def run_apart(reader: Reader, seeds: range) -> tuple[list[Defect], int]:
    """Defects of some files, and the first seed that was not read; in a process of its own."""
    ours, theirs = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.get_context("fork").Process(target=_read_all, args=(reader, seeds, theirs))
    process.start()
    theirs.close()
    defects: list[Defect] = []
    reading = seeds.start
    while True:
        try:
            if not ours.poll(SILENT_S):
                process.kill()
                defects.append(Defect(reader.name, reading, "hangs in native code"))
                break
            message = ours.recv()
        except EOFError:
            process.join()
            if process.exitcode != 0:
                defects.append(Defect(reader.name, reading, f"the process died (exit code {process.exitcode})"))
            else:
                return defects, seeds.stop
            break
        if isinstance(message, int):
            reading = message
        else:
            defects.append(message)
    process.join()
    return defects, reading + 1


def _read_all(reader: Reader, seeds: range, pipe: Connection) -> None:
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + MOST_MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    for defect in attack(reader, seeds, pipe.send):
        pipe.send(defect)
    pipe.close()


if __name__ == "__main__":
    main()
