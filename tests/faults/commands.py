"""Every command that writes, on inputs so small that it takes seconds."""

from __future__ import annotations

import os
import re
import shutil
import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.faults.disk import obey_permissions
from tests.faults.watch import Watch

ROOT = Path(__file__).resolve().parents[2]
BLENDER = Path(__file__).with_name("in_blender.py")
LONGEST_S = 1200.0
SCENE = {"frames = 6": "frames = 4", "width_px = 96": "width_px = 48", "height_px = 54": "height_px = 27"}
TINY_TRAINING = ("--iterations", "20", "20", "--set", "checkpoint_every=20", "--set", "voxel_px=3")


# Read when torch is imported, before `aa4d` is forked.
os.environ["OMP_NUM_THREADS"] = "1"


@dataclass(frozen=True)
class Command:
    """One command line. `{inputs}` stands for the folder of the inputs, `{disk}` for that of everything it writes."""

    name: str
    line: tuple[str, ...]
    has_run: bool = False  # {disk}/run is there beforehand
    program: tuple[str, ...] = ()  # instead of `aa4d`
    only_killed: bool = False  # what it writes is written by Blender itself, which says nothing of a full disk
    scratch_elsewhere: bool = False  # it refuses to begin where scratch files have little room

    def argv(self, inputs: Path, disk: Path) -> list[str]:
        return [part.replace("{inputs}", str(inputs)).replace("{disk}", str(disk)) for part in self.line]


def _of_run(name: str, *line: str) -> Command:
    return Command(name, line, has_run=True)


CAPTURE = (  # the field of view is that of tests/capture/aerial.py: finding it takes most of the time
    *("--movers", "off", "--threads", "1", "--fps", "10", "--longest-px", "320", "--fov", "56.145"),
    *("--set", "reconstruction.features=800"),
)
# A process for each task, which imports everything anew, is what `compare` tries.
ONE_PROCESS = ("--engine", "inline", "--iterations", "4", "4")
COMMANDS = (
    Command("synth", ("synth", "{inputs}/scene.toml", "--out", "{disk}/capture")),
    Command("synth-workers", ("synth", "{inputs}/scene.toml", "--out", "{disk}/capture", "--workers", "2")),
    Command("sheet", ("synth", "sheet", "{inputs}/scene.toml", "--out", "{disk}/sheet")),
    Command("capture", ("capture", "{inputs}/frames", "--out", "{disk}/capture", *CAPTURE)),
    Command("train", ("train", "{inputs}/capture", "--out", "{disk}/run", *TINY_TRAINING)),
    Command(
        "train-tensorboard", ("train", "{inputs}/capture", "--out", "{disk}/run", *TINY_TRAINING, "--tensorboard")
    ),
    _of_run("eval", "eval", "{disk}/run", "--capture", "{inputs}/capture"),
    _of_run("inspect", "inspect", "{disk}/run", "--capture", "{inputs}/capture"),
    _of_run("render", "render", "{disk}/run", "--frames", "3", "--layers", "color", "motion"),
    *(_of_run(f"export-{f}", "export", "{disk}/run", "--format", f, "--frames", "3") for f in
      ("ply", "glb", "spz", "sog", "points", "usd", "usd-points", "track", "html", "4dgs")),
    Command("compare", ("compare", "{inputs}/capture", "--out", "{disk}/out", "--methods", "adaanchor4d",
                        "--iterations", "4", "4", "--seeds", "1")),
    Command("ablate", ("ablate", "motion", "{inputs}/capture", "--out", "{disk}/out", "--seeds", "1", *ONE_PROCESS)),
    Command("sweep", ("sweep", "embedding", "{inputs}/capture", "--out", "{disk}/out", "--seeds", "1", *ONE_PROCESS)),
    Command("experiment", ("experiment", "{inputs}/experiment.toml", "--out", "{disk}/out", "--engine", "inline")),
    Command("stress", ("stress", "--part", "optimiser", "--write", "{disk}/page.md")),
    Command("extension", ("{disk}/adaanchor4d.zip",), program=(sys.executable, str(ROOT / "addon/build_extension.py"))),
    Command("blend", ("{inputs}/model.safetensors", "--extension", "{inputs}/adaanchor4d.zip", "--out",
                      "{disk}/flyover.blend", "--render", "{disk}/flyover.png"),
            program=(sys.executable, str(ROOT / "addon/make_flyover_blend.py")), scratch_elsewhere=True),
    *(Command(f"extension-{what}", ("{inputs}/model.safetensors", "{inputs}/adaanchor4d.zip", "{disk}", what),
              program=(sys.executable, str(BLENDER)), only_killed=what == "bake") for what in ("bake", "ply", "usd")),
)  # fmt: skip
BY_NAME = {command.name: command for command in COMMANDS}


def _make_scene(path: Path) -> None:
    scene = (ROOT / "scenes" / "tiny.toml").read_text()
    for old, new in SCENE.items():
        assert old in scene
        scene = scene.replace(old, new)
    path.write_text(scene)


def _make_run(path: Path) -> None:
    from tests.toy_run import train_toy_run

    train_toy_run(path.parent)  # makes the capture too


def _make_frames(path: Path) -> None:
    from tests.capture import aerial

    aerial.write(path, aerial.pictures(aerial.arc()))


def _make_experiment(path: Path) -> None:
    path.write_text('title = "Two"\nscenes = ["capture"]\npreset = "quick"\niterations = [4, 4]\n[variants.a]\n')


def _make_model(path: Path) -> None:
    from tests.addon.model_files import make_model, write_model

    write_model(path, *make_model(60, 5, groups=1))


def _make_extension(path: Path) -> None:
    from addon.build_extension import build

    build(path)


INPUTS: dict[str, Callable[[Path], object]] = {
    "run": _make_run,
    "frames": _make_frames,
    "scene.toml": _make_scene,
    "experiment.toml": _make_experiment,
    "model.safetensors": _make_model,
    "adaanchor4d.zip": _make_extension,
}


def make_inputs(wanted: Sequence[Command], folder: Path) -> None:
    """What these commands read, in `folder`; what is there already stays."""
    folder.mkdir(parents=True, exist_ok=True)
    line = " ".join(part for command in wanted for part in command.line)
    for name, make in INPUTS.items():
        needs_run = name == "run" and (
            any(f"{{inputs}}/{what}" in line for what in ("capture", "experiment"))
            or any(command.has_run for command in wanted)
        )
        if (needs_run or f"{{inputs}}/{name}" in line) and not (folder / name).exists():
            make(folder / name)


def prepare(command: Command, inputs: Path, disk: Path) -> None:
    """What is on the disk before the command runs."""
    (disk / "tmp").mkdir(exist_ok=True)
    if command.has_run:
        shutil.copytree(inputs / "run", disk / "run")


@dataclass(frozen=True)
class Ended:
    code: int  # negative: the signal that ended it
    said: str
    seconds: float


def start(
    command: Command, inputs: Path, disk: Path, log: Path, *, unprivileged: bool = False, watch: Watch | None = None
) -> int:
    """Begin a command in a session of its own; its process id. Its scratch files lie on the disk too, if it can be.

    `aa4d` is forked from this process, which saves it the imports: nothing may have made threads before.
    """
    scratch = inputs if command.scratch_elsewhere else disk / "tmp"
    environment = {**os.environ, "TMPDIR": str(scratch), "MPLCONFIGDIR": str(inputs)}
    sys.stdout.flush()
    process = os.fork()
    if process:
        return process
    try:
        os.setsid()
        os.environ.update(environment)
        if watch is not None:
            watch.close()  # this one's
        written = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o666)
        os.dup2(written, 1)
        os.dup2(written, 2)
        if unprivileged:
            obey_permissions()
        if command.program:
            os.execv(command.program[0], [*command.program, *command.argv(inputs, disk)])
        _be_aa4d(command.argv(inputs, disk))
    finally:
        os._exit(1)


def _be_aa4d(arguments: list[str]) -> None:
    """As the interpreter runs the program and ends."""
    import tempfile

    from aa4d.cli import main

    tempfile.tempdir = None
    sys.argv = ["aa4d", *arguments]
    code = 0
    try:
        main()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        traceback.print_exc()
        code = 1
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            code = 120
    os._exit(code)


def wait(
    process: int,
    log: Path,
    since: float,
    longest_s: float = LONGEST_S,
    meanwhile: Callable[[float], object] = time.sleep,
) -> Ended:
    """Until it has ended, or was killed for taking too long; whatever it started has ended then too.

    Args:
        meanwhile: takes at least so many seconds, over and over.
    """
    while True:
        ended, status = os.waitpid(process, os.WNOHANG)
        seconds = time.monotonic() - since
        if ended or seconds > longest_s:
            break
        meanwhile(0.01)
    if not ended:
        kill_session(process)
        os.waitpid(process, 0)
        return Ended(-signal.SIGKILL, f"hangs: longer than {longest_s:g} s", seconds)
    return Ended(os.waitstatus_to_exitcode(status), log.read_text(errors="replace"), seconds)


def run(command: Command, inputs: Path, disk: Path, log: Path, *, unprivileged: bool = False) -> Ended:
    since = time.monotonic()
    return wait(start(command, inputs, disk, log, unprivileged=unprivileged), log, since)


def run_watched(
    command: Command, inputs: Path, disk: Path, log: Path, opening: Callable[..., None], written: Callable[..., None]
) -> Ended:
    """The same, with `Watch.hear` telling of the files of the disk meanwhile. Raises NoWatch."""
    watch, since = Watch(disk), time.monotonic()

    def hear(seconds: float) -> None:
        watch.hear(seconds, opening, written)

    try:
        ended = wait(start(command, inputs, disk, log, watch=watch), log, since, meanwhile=hear)
        hear(0.0)
    finally:
        watch.close()
    return ended


def kill_session(leader: int) -> None:
    """Kill every process of the session that `leader` began."""
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and session_of(int(entry.name)) == leader:
            try:
                os.kill(int(entry.name), signal.SIGKILL)
            except ProcessLookupError:
                continue


def living(leader: int) -> list[int]:
    """Processes of that session which still run."""
    found = (int(entry.name) for entry in Path("/proc").iterdir() if entry.name.isdigit())
    return [process for process in found if session_of(process) == leader]


def session_of(process: int) -> int | None:
    """None where it has ended, as a zombie too."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return None if fields[0] in "ZX" else int(fields[3])


def wrong_with(ended: Ended, *, refused: bool) -> str | None:
    """What a command must not do, when it may not succeed (`refused`: it has to say why) or has to."""
    last = ended.said.strip().splitlines()[-1] if ended.said.strip() else ""
    if "Traceback" in ended.said:
        return f"a traceback: {last[:300]}"
    if not refused:
        return None if ended.code == 0 else f"exit code {ended.code}: {ended.said.strip()[-600:]}"
    if ended.code != 2:
        return f"exit code {ended.code}: {ended.said.strip()[-600:]}"
    if not re.search(r"space|writ|[Rr]ead-only|[Pp]ermission|denied|free", last):
        return f"does not say why: {last[-300:]}"
    return None


def chosen(names: Sequence[str]) -> list[Command]:
    return list(COMMANDS) if not names else [BY_NAME[name] for name in names]
