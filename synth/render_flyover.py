"""Render a scene file to a capture: frames, depth, instance ids, tracks, and cameras for nerfstudio and COLMAP.

blender -b -P synth/render_flyover.py -- scenes/crossroads.toml --out captures/crossroads
python synth/render_flyover.py scenes/crossroads.toml --out captures/crossroads      (with the bpy module)
"""

import argparse
import importlib.util
import os
import signal
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path

HOME = Path(__file__).resolve().parent
# Python puts this file's folder first, Blender puts nothing: both need the folder above it.
sys.path[:] = [str(HOME.parent), *(entry for entry in sys.path if Path(entry).resolve() != HOME)]

from synth.capture import INDEX, Folder, open_folder  # noqa: E402
from synth.costs import Costs  # noqa: E402
from synth.errors import InputError  # noqa: E402
from synth.interrupts import interrupt_deferred  # noqa: E402
from synth.plan import document, make_plan  # noqa: E402
from synth.spec import read_scene  # noqa: E402

EPILOG = """\
DIR must be new, empty, or an unfinished capture of the same scene: after Ctrl-C the same command goes on at the
first missing frame. The same scene, seed and version of Blender give the same frames, byte for byte.

examples:
  blender -b -P synth/render_flyover.py -- scenes/crossroads.toml --out captures/crossroads
  python synth/render_flyover.py scenes/crossroads.toml --out captures/crossroads

docs/scenes.md describes every key of a scene file, docs/formats.md the folder that is written.
"""


def main(arguments: Sequence[str]) -> int:
    """Run the command line; returns the exit code: 0 done, 2 bad input, 130 interrupted."""
    parser = argparse.ArgumentParser(
        prog="render_flyover",
        description="Render a drone's flight over traffic, with its ground truth, from a scene file.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("scene", type=Path, metavar="SCENE", help="the scene file (TOML), e.g. scenes/crossroads.toml")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="the capture folder to write")
    # Blender's own handler would end the process in the middle of a frame.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        options = parser.parse_args(arguments)
        run(options.scene, options.out)
    except SystemExit as stop:  # argparse: --help or a usage error
        return int(stop.code or 0)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    except OSError as error:  # a full disk, a folder taken away
        print(f"{error.filename or options.out}: {error.strerror}; what is finished is kept.", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("\nInterrupted: what is finished is kept, and the same command continues from there.", file=sys.stderr)
        return 130
    return 0


def run(scene_path: Path, out: Path) -> None:
    """Render what is missing of a capture, and write its index last."""
    scene = read_scene(scene_path)
    try:
        plan = make_plan(scene, scene_path.parent)
    except InputError as error:
        raise InputError(f"{scene_path}: {error}") from None
    if importlib.util.find_spec("bpy") is None:
        raise InputError(
            "Blender is missing: run this file with `blender -b -P`, or install Blender's Python module "
            "(`pip install bpy`, Python 3.11)."
        )
    with interrupt_deferred():
        from synth.blender.film import film
        from synth.blender.session import version
        from synth.export.capture import export

    plan_document = document(plan, version())
    state = open_folder(out, plan_document)
    if state == "finished":
        print(f"{out / INDEX}: this capture is complete already, nothing to render")
        return
    folder, costs = Folder(out), Costs(out / "cost.json")
    print(f"{scene.name}: {len(plan.frames)} frames, {len(plan.fleet.instances)} vehicles, into {out}", flush=True)
    film(plan, folder, costs)
    export(plan, folder, {**plan_document["generator"], "scene": scene_path.name, "seed": scene.seed}, costs)
    for name in (INDEX, "frames/", "truth/", "points.ply", "transforms.json", "sparse/0/", "cost.json"):
        print(f"{out}/{name}")


def own_arguments() -> list[str]:
    """The command line without Blender's part, which ends at "--"."""
    if "--" in sys.argv:
        return sys.argv[sys.argv.index("--") + 1 :]
    return sys.argv[1:] if "bpy" not in sys.modules else []


if __name__ == "__main__":
    try:
        code = main(own_arguments())
    except Exception:
        traceback.print_exc()
        code = 1
    if "bpy" in sys.modules:
        from synth.blender.session import remove_temporary_folder

        remove_temporary_folder()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)  # bpy 4.5 hangs in the interpreter's regular exit
