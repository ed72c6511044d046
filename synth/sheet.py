"""Scenes at a glance: a few frames from the middle of each clip at draft quality, their truth, and the seconds.

python synth/sheet.py scenes/arc*.toml --out sheet          (with the bpy module)
aa4d synth sheet scenes/arc*.toml --out sheet               (and the contact sheet)
"""

import argparse
import math
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

HOME = Path(__file__).resolve().parent
sys.path[:] = [str(HOME.parent), *(entry for entry in sys.path if Path(entry).resolve() != HOME)]

from synth.capture import Folder  # noqa: E402
from synth.costs import Costs  # noqa: E402
from synth.errors import InputError  # noqa: E402
from synth.files import write_bytes, write_json, write_npz  # noqa: E402
from synth.interrupts import interrupt_deferred  # noqa: E402
from synth.leaving import exit_code, leave, own_arguments  # noqa: E402
from synth.parent import end_with_parent  # noqa: E402
from synth.plan import Frame, Plan, make_plan  # noqa: E402
from synth.progress import Progress  # noqa: E402
from synth.spec import Render, Scene, read_scene  # noqa: E402
from synth.truth.derive import derive  # noqa: E402

DRAFT = Render(samples=4, denoise=True)
PASSES = ("depth_z", "instance_id", "flow", "activity")
FEWEST = 3  # frames: one that loads the geometry, one with its neighbour for the flow, one more for the median


def excerpt(plan: Plan, count: int) -> Plan:
    """The same clip, of which only the `count` frames in the middle are filmed."""
    first = max(0, (len(plan.frames) - count) // 2)
    chosen = plan.frames[first : first + count]
    return replace(plan, frames=tuple(replace(frame, rank=rank) for rank, frame in enumerate(chosen)))


def shoot(scene: Scene, home: Path, count: int, scratch: Path, advance: Callable[[float], None]) -> dict[str, Any]:
    """Film a scene's excerpt; its seconds, and under "frame" the one to show.

    The first frame after Blender went over to the truth or to the picture loads the geometry: what it takes longer
    than the others is `load_s`, paid once in a batch of frames.
    """
    from synth.blender.film import BATCH, film

    draft = replace(scene, render=DRAFT, truth=replace(scene.truth, passes=PASSES))
    costs, folder, start = Costs(None), Folder(scratch), time.perf_counter()
    plan = excerpt(make_plan(draft, home), count)
    plan_s = time.perf_counter() - start
    film(plan, folder, plan.frames, costs, advance)
    derive(plan, folder, costs, lambda _: None)

    first, *others = (costs.frames[frame.name] for frame in plan.frames)
    usual = {key: statistics.median(frame[key] for frame in others) for key in first}
    derived = sum(costs.stages.get(name, 0.0) for name in ("flow", "activity")) / len(plan.frames)
    load = sum(max(0.0, first[key] - usual[key]) for key in first)
    setup, each, total = plan_s + costs.stages["build"], sum(usual.values()) + derived, scene.time.frames
    return {
        "scene": scene.name,
        "frames": total,
        "setup_s": round(setup, 2),
        "load_s": round(load, 2),
        "picture_s": round(usual["picture"], 3),
        "truth_s": round(usual["truth"] + derived, 3),
        "clip_s": round(setup + math.ceil(total / BATCH) * load + total * each, 1),
        "show": (folder, plan.frames[len(plan.frames) // 2]),
    }


def keep(folder: Folder, frame: Frame, out: Path) -> None:
    """The frame, and the passes of the sheet, under names that say which."""
    write_bytes(out / "frame.png", folder.developed(frame).read_bytes())
    write_bytes(out / "activity.png", folder.truth_pass("activity", frame).read_bytes())
    import numpy as np

    with np.load(folder.truth_pass("flow", frame), allow_pickle=False) as flow:
        write_npz(out / "truth.npz", depth_z=folder.read_truth(frame)["depth_z"], flow_forward=flow["flow_forward"])


def measure(paths: Sequence[Path], out: Path, count: int) -> dict[str, Any]:
    """Every scene in turn; DIR/NAME of each holds what the sheet shows. All scenes are read before the first."""
    from synth.blender.session import version

    scenes = [read_scene(path) for path in paths]
    names = [scene.name for scene in scenes]
    for path, scene in zip(paths, scenes, strict=True):
        if scene.time.frames < count:
            raise InputError(f"{path}: has {scene.time.frames} frames; a sheet takes {count} of each scene.")
        if names.count(scene.name) > 1:
            raise InputError(f"{path}: another scene of the sheet has the name {scene.name!r} too; rename one.")
    progress, rows = Progress("frame", len(scenes) * count), []
    for path, scene in zip(paths, scenes, strict=True):
        with tempfile.TemporaryDirectory(prefix="aa4d-sheet-") as scratch:
            try:
                row = shoot(scene, path.parent, count, Path(scratch), progress.advance)
            except InputError as error:
                raise InputError(f"{path}: {error}") from None
            folder, frame = row.pop("show")
            keep(folder, frame, out / scene.name)
        row["load_average"] = round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None
        rows.append(row)
    return {
        "blender": version(),
        "processors": os.cpu_count(),
        "samples": DRAFT.samples,
        "denoise": DRAFT.denoise,
        "filmed_frames": count,
        "size": [scenes[0].camera.width_px, scenes[0].camera.height_px],
        "scenes": rows,
    }


def table(found: dict[str, Any]) -> str:
    """The seconds for a terminal."""
    columns = list(found["scenes"][0])
    lines = [[str(row[name]) for name in columns] for row in found["scenes"]]
    widths = [max(map(len, column)) for column in zip(columns, *lines, strict=True)]
    return "\n".join(
        "  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)) for line in (columns, *lines)
    )


def main(arguments: Sequence[str]) -> None:
    """Run the command line; raises InputError."""
    parser = argparse.ArgumentParser(prog="sheet", description=__doc__.split("\n", 1)[0])
    parser.add_argument("scenes", type=Path, nargs="+", metavar="SCENE")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="where sheet.json and NAME/ are written")
    parser.add_argument("--frames", type=int, default=4, metavar="N", help="frames to film of each (default: 4)")
    end_with_parent()
    options = parser.parse_args(arguments)
    if options.frames < FEWEST:
        raise InputError(f"--frames {options.frames}: must be at least {FEWEST}.")
    with interrupt_deferred():
        from synth.blender.session import silence
    silence()
    found = measure(options.scenes, options.out, options.frames)
    write_json(options.out / "sheet.json", found)
    print(table(found))
    print(options.out / "sheet.json")


if __name__ == "__main__":
    leave(exit_code(lambda: main(own_arguments()), "; no sheet is written"))
