"""What `aa4d synth cost` measures, once for all panels of synthesis."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from aa4d.blender import run_in_blender, script
from aa4d.cost.kind import cost_task
from aa4d.cost.panel import Setup
from aa4d.files import read_json_object
from aa4d.graph.call import Call
from aa4d.graph.child import run_child
from aa4d.graph.task import Task
from aa4d.scene_files import scene_digest

STEP = re.compile(r"measurement (\d+)/(\d+)")
REFERENCE_SAMPLES = {"quick": 256, "full": 1024}
SECONDS = {"quick": 90.0, "full": 600.0}


def measure(call: Call) -> dict[str, Any]:
    """The content of what synth/cost.py writes. Raises InputError with its last line where it refuses."""
    settings = call.task.settings
    reference = str(settings.given["reference"])
    arguments = (str(settings.paths["scene"]), "--out", str(call.folder), "--reference", reference)

    def run(hear: Callable[[str], None]) -> int:
        def count(line: str) -> None:
            if (step := STEP.match(line)) is not None:
                call.advance(int(step[1]), int(step[2]))
            hear(line)

        return run_in_blender("synth/cost.py", *arguments, hear=count)

    run_child(call, run, "synth/cost.py")
    return read_json_object(call.folder / "cost.json", "the measurements of `aa4d synth cost`")


def synthesis_task(setup: Setup) -> Task:
    scene, size = script(setup.size.small_scene), setup.size.name
    given = {"scene": scene_digest(scene), "reference": REFERENCE_SAMPLES[size]}
    return cost_task(__name__, "synthesis", given, seconds=SECONDS[size], paths={"scene": scene})
