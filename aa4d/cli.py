"""The command line: every command, by its name."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable

import tyro
from rich.console import Console

from aa4d import __version__
from aa4d.commands.ablate import ablate
from aa4d.commands.bench import bench
from aa4d.commands.capture import capture
from aa4d.commands.demo import demo
from aa4d.commands.evaluate import evaluate
from aa4d.commands.export import export
from aa4d.commands.inspect import inspect
from aa4d.commands.render import render
from aa4d.commands.sweep import sweep
from aa4d.commands.synth import synth
from aa4d.commands.train import train
from aa4d.errors import InputError, Interrupted
from aa4d.interrupts import end_quietly_while_importing

DESCRIPTION = (
    "AdaAnchor4D: drone video of moving traffic becomes a 4D scene that you can scrub in Blender. "
    "`aa4d demo` does it all; the other commands are its steps. Every command can be stopped and run again."
)
# OpenMP's idle threads spin for milliseconds by default. Where another program wants a core, each of the hundreds of
# short parallel regions of an iteration then waits for a spinning thread's time slice: up to 8 times slower with two
# busy cores, and no faster on idle ones. Read when torch is loaded, hence here.
os.environ.setdefault("GOMP_SPINCOUNT", "2000")

COMMANDS: dict[str, Callable[..., None]] = {
    "synth": synth,
    "capture": capture,
    "train": train,
    "eval": evaluate,
    "inspect": inspect,
    "render": render,
    "export": export,
    "demo": demo,
    "ablate": ablate,
    "sweep": sweep,
    "bench": bench,
}
app = tyro.extras.SubcommandApp()
for name, command in COMMANDS.items():
    app.command(name=name)(command)


def main() -> None:
    end_quietly_while_importing()  # commands import what they need
    if sys.argv[1:] == ["--version"]:
        print(f"aa4d {__version__}")
        return
    try:
        if any(a == "" or (a.startswith("--") and a.endswith("=")) for a in sys.argv[1:]):
            # As a path it would be the current folder.
            raise InputError("an argument is empty; name what it should be (is a variable of the shell not set?)")
        app.cli(prog="aa4d", description=DESCRIPTION)
    except InputError as error:
        Console(stderr=True).print(f"aa4d: {error}", markup=False, highlight=False, soft_wrap=True)
        sys.exit(2)
    except OSError as error:  # a full disk, a file that may not be replaced
        where = error.filename2 or error.filename or "the output"
        sentence = f"aa4d: {where}: {error.strerror or error}; mend that, and run the same command again"
        Console(stderr=True).print(sentence, markup=False, highlight=False, soft_wrap=True)
        sys.exit(2)
    except Interrupted as stop:
        Console(stderr=True).print(f"aa4d: {stop}", markup=False, highlight=False, soft_wrap=True)
        sys.exit(130)
    except KeyboardInterrupt:
        Console(stderr=True).print("aa4d: stopped", markup=False)
        sys.exit(130)


if __name__ == "__main__":
    main()
