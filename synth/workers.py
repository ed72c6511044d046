"""Frame shards over worker processes. A worker renders one shard and ends: Blender's memory ends with it.

What a frame shows depends on the plan and its rank alone, so the bytes are the same for any number of workers.
"""

import json
import queue
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence

from synth.costs import Costs
from synth.plan import Frame

SHARD = 48  # frames: long enough that starting Blender does not count
ADVANCE, COSTS = "advance ", "costs "  # what a worker says, one line each


class WorkerError(Exception):
    """A worker ended with an exit code that is not zero: its last words."""

    def __init__(self, code: int, words: str) -> None:
        super().__init__(words)
        self.code = code


def shards(frames: Sequence[Frame], workers: int) -> list[list[Frame]]:
    """Frames in pieces of neighbours, at least one for each worker where there are enough."""
    length = max(1, min(SHARD, -(-len(frames) // workers)))
    return [list(frames[start : start + length]) for start in range(0, len(frames), length)]


def film_in_workers(
    command: Callable[[list[Frame]], list[str]],
    pieces: list[list[Frame]],
    workers: int,
    costs: Costs,
    advance: Callable[[float], None],
) -> None:
    """Run `command(shard)` for every shard, at most `workers` at a time.

    On Ctrl-C each worker finishes its frame.

    Raises:
        WorkerError: after the others have finished their frame.
    """
    waiting, ended = list(pieces), 0
    running: list[subprocess.Popen[str]] = []
    said: queue.Queue[tuple[subprocess.Popen[str], str | None]] = queue.Queue()
    failure: WorkerError | None = None

    def listen(process: "subprocess.Popen[str]") -> None:
        assert process.stdout is not None
        for line in process.stdout:
            said.put((process, line))
        said.put((process, None))

    try:
        while ended < len(pieces) and not (failure and not running):
            while waiting and len(running) < workers and failure is None:
                process = subprocess.Popen(command(waiting.pop(0)), stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                           text=True, process_group=0)  # fmt: skip
                running.append(process)
                threading.Thread(target=listen, args=(process,), daemon=True).start()
            process, line = said.get()
            if line is None:
                words = process.stderr.read() if process.stderr else ""
                running.remove(process)
                ended += 1
                if process.wait() != 0 and failure is None:
                    failure = WorkerError(process.returncode, words)
                    _interrupt(running)
            elif line.startswith(ADVANCE):
                advance(float(line.removeprefix(ADVANCE)))
            elif line.startswith(COSTS):
                costs.add(json.loads(line.removeprefix(COSTS)))
                costs.save()
    except KeyboardInterrupt:
        _interrupt(running)
        while running:
            process, line = said.get()
            if line is None:
                process.wait()
                running.remove(process)
            elif line.startswith(COSTS):
                costs.add(json.loads(line.removeprefix(COSTS)))
        raise
    if failure is not None:
        raise failure


def _interrupt(processes: "Sequence[subprocess.Popen[str]]") -> None:
    from signal import SIGINT

    for process in processes:
        process.send_signal(SIGINT)


def say_advance(share: float) -> None:
    """A worker's word for finished work."""
    print(f"{ADVANCE}{share}", file=sys.stdout, flush=True)


def say_costs(costs: Costs) -> None:
    """A worker's last line."""
    print(f"{COSTS}{json.dumps(costs.document())}", file=sys.stdout, flush=True)
