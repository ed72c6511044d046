"""Film a plan: build it in Blender and render every frame that is missing from the capture."""

import tempfile
from pathlib import Path

from synth.blender.build import build_stage
from synth.blender.passes import linear_rgb, truth
from synth.blender.render import make_renderer
from synth.blender.session import silence, start_empty
from synth.capture import Folder
from synth.costs import Costs
from synth.develop import png, srgb_from_linear
from synth.files import write_bytes, write_npz
from synth.plan import Plan
from synth.progress import Progress

# Blender keeps the loaded geometry of one scene at a time: going back and forth between the truth and the picture for
# every frame would load it twice a frame, which takes longer than the truth itself.
BATCH = 24
TRUTH_SHARE = 0.15  # of the time of a frame, for the estimate of what is left


def film(plan: Plan, folder: Folder, costs: Costs) -> None:
    """Write the picture and the truth of every missing frame; each file appears whole."""
    missing = [frame for frame in plan.frames if not folder.complete(frame)]
    if not missing:
        return
    silence()
    if len(missing) < len(plan.frames):
        print(f"{len(plan.frames) - len(missing)} of {len(plan.frames)} frames are there; rendering the others")
    with tempfile.TemporaryDirectory(prefix="aa4d-synth-") as scratch:
        with costs.stage("build"):
            start_empty()
            stage = build_stage(plan)
            renderer = make_renderer(stage.scene, plan.scene.camera, plan.scene.render, Path(scratch))
        progress = Progress("frame", len(missing))
        for start in range(0, len(missing), BATCH):
            batch = missing[start : start + BATCH]
            for frame in batch:
                if not folder.truth(frame).is_file():
                    stage.place(plan, frame)
                    with costs.stage("truth", frame.name):
                        write_npz(folder.truth(frame), **truth(renderer.render_truth()))
                progress.advance(TRUTH_SHARE)
            for frame in batch:
                if not folder.image(frame).is_file():
                    stage.place(plan, frame)
                    with costs.stage("picture", frame.name):
                        linear = linear_rgb(renderer.render_picture(frame.seed))
                        write_bytes(folder.image(frame), png(srgb_from_linear(linear)))
                costs.save()
                progress.advance(1 - TRUTH_SHARE)
