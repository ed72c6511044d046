"""What `addon/bench_addon.py` measures in Blender, once for all panels of playback."""

from __future__ import annotations

import importlib.util
import sys
from typing import Any

from aa4d.blender import run_forwarding_interrupts, script
from aa4d.cost.inputs import no_capture, scored
from aa4d.cost.kind import cost_task
from aa4d.cost.models import usual_run
from aa4d.cost.panel import Setup
from aa4d.cost.training import base
from aa4d.files import read_json_object
from aa4d.graph.call import Call
from aa4d.graph.child import run_child
from aa4d.graph.task import Task

ANCHORS = {"quick": 5_000, "full": 20_000}
SAMPLES = {"quick": 4, "full": 64}
SECONDS = {"quick": 60.0, "full": 600.0}


def measure(call: Call) -> dict[str, Any]:
    """The content of what bench_addon.py writes, with the number of anchors. Raises InputError where it refuses."""
    run, evaluation = call.needs
    given, extension, found = call.task.settings.given, call.folder / "extension.zip", call.folder / "addon.json"
    model, pictures = run.folder / "model.safetensors", evaluation.folder / "eval"
    _run(call, str(script("addon/build_extension.py")), str(extension))
    _run(
        call,
        *(str(script("addon/bench_addon.py")), "--extension", str(extension), "--json", str(found)),
        *("--model", str(model), "--pictures", str(pictures)),
        *("--samples", str(given["samples"]), "--anchors", str(given["anchors"])),
    )
    extension.unlink()
    return read_json_object(found, "the measurements of the extension") | {"anchors": given["anchors"]}


def _run(call: Call, *arguments: str) -> None:
    run_child(call, lambda hear: run_forwarding_interrupts([sys.executable, *arguments], hear), arguments[0])


def playback_task(setup: Setup) -> Task:
    size = setup.size.name
    given = {"anchors": ANCHORS[size], "samples": SAMPLES[size]}
    needs = (usual_run(setup), scored(setup, "usual", base(setup)))
    return cost_task(__name__, "playback", given, needs, seconds=SECONDS[size])


def missing(setup: Setup) -> str | None:
    if importlib.util.find_spec("bpy") is None:
        return "Blender's Python module is not here; install it with pip install -e '.[blender]'"
    return no_capture(setup)
