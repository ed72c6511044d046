"""Render a scene file to a capture: frames, depth, instance ids, tracks, and cameras for nerfstudio and COLMAP.

blender -b -P synth/render_flyover.py -- scenes/crossroads.toml --out captures/crossroads
python synth/render_flyover.py scenes/crossroads.toml --out captures/crossroads      (with the bpy module)
"""

import argparse
import importlib.util
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

HOME = Path(__file__).resolve().parent
# Python puts this file's folder first, Blender puts nothing: both need the folder above it.
sys.path[:] = [str(HOME.parent), *(entry for entry in sys.path if Path(entry).resolve() != HOME)]

from synth.capture import INDEX, SECOND, Folder, open_folder  # noqa: E402
from synth.costs import Costs  # noqa: E402
from synth.errors import InputError  # noqa: E402
from synth.interrupts import interrupt_deferred  # noqa: E402
from synth.leaving import exit_code, leave, own_arguments  # noqa: E402
from synth.ledger import mend, told  # noqa: E402
from synth.parent import end_with_parent  # noqa: E402
from synth.plan import Drone, Frame, Plan, document, make_plan  # noqa: E402
from synth.progress import Progress  # noqa: E402
from synth.spec import read_scene  # noqa: E402

EPILOG = """\
DIR must be new, empty, or an unfinished capture of the same scene: after Ctrl-C the same command goes on at the
first missing frame; what is damaged is made again. The same scene, seed and version of Blender give the same frames,
byte for byte.

examples:
  blender -b -P synth/render_flyover.py -- scenes/crossroads.toml --out captures/crossroads
  python synth/render_flyover.py scenes/crossroads.toml --out captures/crossroads

docs/scenes.md describes every key of a scene file, docs/formats.md the folder that is written.
"""


def main(arguments: Sequence[str]) -> None:
    """Run the command line. Raises InputError, OSError where a disk is full, and KeyboardInterrupt."""
    parser = argparse.ArgumentParser(
        prog="render_flyover",
        description="Render a drone's flight over traffic, with its ground truth, from a scene file.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("scene", type=Path, metavar="SCENE", help="the scene file (TOML), e.g. scenes/crossroads.toml")
    parser.add_argument("--out", type=Path, metavar="DIR", help="the capture folder to write")
    parser.add_argument(
        "--workers",
        type=int,
        default=1,
        metavar="N",
        help="processes that render at the same time (default: 1); the bytes are the same for any number",
    )
    parser.add_argument("--explain", action="store_true", help="print what would be rendered, and render nothing")
    parser.add_argument("--ranks", help=argparse.SUPPRESS)  # a worker's shard, as "12,13,14"
    parser.add_argument("--drone", choices=("first", "second"), default="first", help=argparse.SUPPRESS)  # a worker's
    end_with_parent()
    # Blender's own handler would end the process in the middle of a frame.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    options = parser.parse_args(arguments)
    if options.explain:
        from synth.explain import explain

        plan = resolve(options.scene)
        print(explain(plan))
        if plan.scene.second_flight is not None:
            print(f"second drone, into {SECOND}/\n{explain(resolve(options.scene, 'second'))}")
    elif options.out is None:
        parser.error("the following arguments are required: --out")
    elif options.workers < 1:
        raise InputError(f"--workers {options.workers}: must be at least 1")
    elif options.ranks is not None:
        work(options.scene, options.out, [int(rank) for rank in options.ranks.split(",")], options.drone)
    else:
        plans = {options.out: resolve(options.scene)}
        if plans[options.out].scene.second_flight is not None:
            plans[options.out / SECOND] = resolve(options.scene, "second")
        load_blender()
        for out, plan in plans.items():
            run(plan, options.scene, out, options.workers)


def resolve(scene_path: Path, drone: Drone = "first") -> Plan:
    """The plan of a scene file for one of its drones."""
    scene = read_scene(scene_path)
    try:
        return make_plan(scene, scene_path.parent, drone)
    except InputError as error:
        raise InputError(f"{scene_path}: {error}") from None


def load_blender() -> None:
    """Import bpy, and quieten it. Raises InputError where there is none."""
    if importlib.util.find_spec("bpy") is None:
        raise InputError(
            "Blender is missing: run this file with `blender -b -P`, or install Blender's Python module "
            "(`pip install bpy`, Python 3.11)."
        )
    with interrupt_deferred():
        import synth.blender.film  # noqa: F401
        from synth.blender.session import silence
    silence()


def folder_of(plan: Plan, out: Path) -> Folder:
    return Folder(out, encoded=any(effect.stage == "encode" for effect in plan.effects))


def run(plan: Plan, scene_path: Path, out: Path, workers: int) -> None:
    """Render what is missing of a drone's capture, and write its index last. Blender is loaded."""
    scene = plan.scene
    import bpy

    from synth.blender.requirements import refuse_what_is_missing
    from synth.blender.session import start_empty, version
    from synth.export.capture import export

    start_empty()
    refuse_what_is_missing(plan, bpy)  # before anything is written

    plan_document = document(plan, version())
    state = open_folder(out, plan_document)
    folder = folder_of(plan, out)
    if state != "new":
        wrong = mend(out, folder.kept(plan.frames), finished=state == "finished")
        if wrong:
            print(told(out, wrong), flush=True)
            state = "unfinished"
    if state == "finished":
        print(f"{out / INDEX}: this capture is complete already, nothing to render")
        return
    costs = Costs(out / "cost.json")
    print(f"{scene.name}: {len(plan.frames)} frames, {len(plan.fleet.instances)} vehicles, into {out}", flush=True)
    for note in plan.fleet.notes:
        print(f"note: {note}", flush=True)
    missing = [frame for frame in plan.frames if not folder.complete(frame)]
    if 0 < len(missing) < len(plan.frames):
        print(f"{len(plan.frames) - len(missing)} of {len(plan.frames)} frames are there; rendering the others")
    if missing:
        film_missing(plan, folder, missing, costs, scene_path, workers)
    with costs.saved():
        export(plan, folder, plan_document, scene_path.name, costs)
    for name in (INDEX, "frames/", "truth/", "points.ply", "transforms.json", "sparse/0/", "cost.json"):
        print(f"{out}/{name}")


def film_missing(
    plan: Plan, folder: Folder, missing: list[Frame], costs: Costs, scene_path: Path, workers: int
) -> None:
    """In this process, or shard by shard in workers."""
    if workers == 1:
        from synth.blender.film import film

        film(plan, folder, missing, costs, Progress("frame", len(missing)).advance)
        return
    from synth.workers import WorkerError, film_in_workers, shards

    progress = Progress("frame", len(missing))

    def command(shard: list[Frame]) -> list[str]:
        arguments = [str(scene_path), "--out", str(folder.root), "--drone", plan.drone]
        arguments += ["--ranks", ",".join(str(f.rank) for f in shard)]
        import bpy

        if bpy.app.binary_path:
            return [bpy.app.binary_path, "-b", "-P", __file__, "--", *arguments]
        return [sys.executable, __file__, *arguments]

    try:
        film_in_workers(command, shards(missing, workers), workers, costs, progress.advance)
    except WorkerError as failed:
        if failed.code == 130:
            raise KeyboardInterrupt from None
        raise InputError(f"A worker ended with exit code {failed.code}: {str(failed).strip()[-2000:]}") from None


def work(scene_path: Path, out: Path, ranks: list[int], drone: Drone) -> None:
    """As a worker: render the frames of these ranks, and say how it goes on standard output."""
    plan = resolve(scene_path, drone)
    load_blender()
    from synth.blender.film import film
    from synth.workers import say_advance, say_costs

    folder, costs = folder_of(plan, out), Costs(None)
    try:
        film(plan, folder, [plan.frames[rank] for rank in ranks], costs, say_advance)
    finally:
        say_costs(costs)


if __name__ == "__main__":
    kept = "what is finished is kept"
    leave(exit_code(lambda: main(own_arguments()), f": {kept}, and the same command continues from there", f"; {kept}"))
