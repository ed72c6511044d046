"""Film a plan: build it in Blender and render the frames that are asked for."""

import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from synth.blender.build import Stage, build_stage
from synth.blender.extras import Extra, build_extras
from synth.blender.passes import linear_rgb, truth
from synth.blender.render import Renderer, make_renderer
from synth.blender.requirements import refuse_what_is_missing
from synth.blender.session import start_empty
from synth.capture import Folder
from synth.costs import Costs
from synth.develop import Shot, develop, png
from synth.plan import Frame, Plan
from synth.staging import Extras

# Blender keeps the loaded geometry of one scene at a time: going back and forth between the truth and the picture for
# every frame would load it twice a frame, which takes longer than the truth itself.
BATCH = 24
TRUTH_SHARE = 0.15  # of the time of a frame, for the estimate of what is left


def film(plan: Plan, folder: Folder, frames: Sequence[Frame], costs: Costs, advance: Callable[[float], None]) -> None:
    """Write the picture and the truth of frames that are missing; each file appears whole.

    `advance` is called with the share of a frame that is finished.
    """
    with tempfile.TemporaryDirectory(prefix="aa4d-synth-") as scratch, costs.saved():
        with costs.stage("build"):
            filming = Filming(plan, folder, costs, Path(scratch))
        for start in range(0, len(frames), BATCH):
            batch = frames[start : start + BATCH]
            for frame in batch:
                if not folder.truth(frame).is_file():
                    filming.film_truth(frame)
                advance(TRUTH_SHARE)
            for frame in batch:
                if not folder.developed(frame).is_file():
                    filming.film_picture(frame)
                costs.save()
                advance(1 - TRUTH_SHARE)


class Filming:
    """A plan that is built in Blender, ready to render."""

    def __init__(self, plan: Plan, folder: Folder, costs: Costs, scratch: Path) -> None:
        self.plan, self.folder, self.costs = plan, folder, costs
        start_empty()
        refuse_what_is_missing(plan, bpy)
        self.stage: Stage = build_stage(plan)
        self.extras: tuple[Extra, ...] = build_extras(plan, self.stage.scene)
        for staging in plan.staging:
            staging.build(StageHands(self.stage, self.extras))
        self.renderer: Renderer = make_renderer(self.stage.scene, plan, scratch)

    def place(self, frame: Frame) -> None:
        """Bring everything to the frame's instant."""
        if not self.plan.shutter.instant:
            from synth.blender.motion import stand_still

            stand_still(self.stage, self.extras)
        self.stage.place(self.plan, frame)
        for extra in self.extras:
            extra.place(frame.time_s)
        for staging in self.plan.staging:
            staging.place(frame.time_s)

    def film_truth(self, frame: Frame) -> None:
        self.place(frame)
        with self.costs.stage("truth", frame.name):
            arrays = truth(self.renderer.render_truth(), self.plan, frame)
            self.folder.keep_arrays(self.folder.truth(frame), **arrays)

    def film_picture(self, frame: Frame) -> None:
        self.place(frame)
        with self.costs.stage("picture", frame.name):
            if not self.plan.shutter.instant:
                from synth.blender.motion import animate

                animate(self.plan, frame, self.stage, self.extras)
            linear = linear_rgb(self.renderer.render_picture(frame.seed))
            if any(self.plan.lens.margin_px):
                linear = self._through_the_lens(linear)
            shot = Shot(self.plan, frame, partial(self._depth, frame))
            image = develop(linear, shot, self.costs.effect)
            self.folder.keep(self.folder.developed(frame), png(image))

    def _depth(self, frame: Frame) -> np.ndarray:
        return np.asarray(self.folder.read_truth(frame)["depth_z"])

    def _through_the_lens(self, linear: np.ndarray) -> np.ndarray:
        from synth.effects.lens_distortion import picture

        camera = self.plan.scene.camera
        with self.costs.effect("lens_distortion"):
            return picture(self.plan.lens, linear, (camera.width_px, camera.height_px))


class StageHands:
    """What an effect of the stage "scene" is handed: Blender's data, and what stands on the stage."""

    def __init__(self, stage: Stage, extras: Sequence[Extra]) -> None:
        self.data, self.scene = bpy.data, stage.scene
        self.extras = extras

    def objects_of(self, extras: Extras) -> tuple[Any, ...]:
        """The objects that were built for an effect's instances."""
        return next(extra.objects for extra in self.extras if extra.extras is extras)
