"""The command line: every command, by its name."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from rich.console import Console
from tyro.extras import SubcommandApp

from aa4d import __version__
from aa4d.commands import bench, synth
from aa4d.commands.ablate import ablate
from aa4d.commands.capture import capture
from aa4d.commands.compare import compare
from aa4d.commands.cost import cost
from aa4d.commands.demo import demo
from aa4d.commands.evaluate import evaluate
from aa4d.commands.experiment import experiment
from aa4d.commands.export import export
from aa4d.commands.inspect import inspect
from aa4d.commands.render import render
from aa4d.commands.report import report
from aa4d.commands.stress import stress
from aa4d.commands.sweep import sweep
from aa4d.commands.train import train
from aa4d.commands.view import view
from aa4d.errors import InputError, Interrupted
from aa4d.interrupts import end_quietly_while_importing
from aa4d.settings.checking import nearest, one_of

DESCRIPTION = (
    "AdaAnchor4D: drone video of moving traffic becomes a 4D scene that you can scrub in Blender. "
    "`aa4d demo` does it all; the other commands are its steps. Every command can be stopped and run again."
)
# OpenMP's idle threads spin for milliseconds by default. Where another program wants a core, each of the hundreds of
# short parallel regions of an iteration then waits for a spinning thread's time slice: up to 8 times slower with two
# busy cores, and no faster on idle ones. Read when torch is loaded, hence here.
os.environ.setdefault("GOMP_SPINCOUNT", "2000")

Command = Callable[..., None] | Mapping[str, Callable[..., None]]  # a mapping has commands of its own
COMMANDS: dict[str, Command] = {
    "synth": synth.COMMANDS,
    "capture": capture,
    "train": train,
    "eval": evaluate,
    "inspect": inspect,
    "render": render,
    "view": view,
    "export": export,
    "demo": demo,
    "compare": compare,
    "ablate": ablate,
    "sweep": sweep,
    "experiment": experiment,
    "cost": cost,
    "report": report,
    "bench": bench.COMMANDS,
    "stress": stress,
}
ABOUT = {
    "synth": "Render a scene file as a capture, with Blender; or check and measure that. "
    "`aa4d synth SCENE` is `aa4d synth render SCENE`.",
    "bench": "Measure training or the CPU rasterizer on this machine, on made-up scenes.",
}


def app_of(commands: Mapping[str, Command]) -> SubcommandApp:
    app = SubcommandApp()
    for name, command in commands.items():
        if isinstance(command, Mapping):
            app.command(app_of(command), name=name, help=ABOUT[name])
        else:
            app.command(name=name)(command)
    return app


def checked(arguments: list[str]) -> list[str]:
    """The arguments, with `synth SCENE` as `synth render SCENE`. Raises InputError for what no command can mean."""
    if any(a == "" or (a.startswith("--") and a.find("=") == len(a) - 1) for a in arguments):
        # As a path it would be the current folder.
        raise InputError("an argument is empty; name what it should be (is a variable of the shell not set?)")
    name, *rest = arguments or [""]
    if name and not name.startswith("-") and name not in COMMANDS:
        raise InputError(f"{name}: no such command; it must be {one_of(COMMANDS, name)}")
    if name == "synth" and rest and rest[0] not in ("-h", "--help", *synth.COMMANDS):
        near = nearest(rest[0], synth.COMMANDS)
        if near and not Path(rest[0]).exists():
            raise InputError(f"aa4d synth {rest[0]}: neither a scene file nor a command; did you mean {near}?")
        return ["synth", "render", *rest]
    return arguments


def main() -> None:
    end_quietly_while_importing()  # commands import what they need
    if isinstance(sys.stdout, io.TextIOWrapper):  # a file's name may hold what the terminal's encoding has not
        sys.stdout.reconfigure(errors="backslashreplace")
    if sys.argv[1:] == ["--version"]:
        print(f"aa4d {__version__}")
        return
    try:
        app_of(COMMANDS).cli(prog="aa4d", description=DESCRIPTION, args=checked(sys.argv[1:]))
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
