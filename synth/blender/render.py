"""Two renders of a frame: the picture with many samples, the truth with one.

At one sample, unfiltered and without blur, Cycles takes depth and ids at the centre of the pixel: they are exact, where
the picture's own passes would be averages over its samples.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

from synth.blender.materials import INSTANCE
from synth.blender.passes import add_class_pass, needs_normals, read_passes
from synth.errors import InputError
from synth.interrupts import interrupt_deferred
from synth.plan import Plan
from synth.shutter import Shutter
from synth.spec import Render


@dataclass(frozen=True)
class Renderer:
    """Two Blender scenes over the same objects, each with its own settings. Going from one to the other is slow."""

    picture: Any
    truth: Any
    scratch: Path

    def render_picture(self, seed: int) -> dict[str, Any]:
        """The channels of the picture."""
        self.picture.cycles.seed = seed
        return self._render(self.picture)

    def render_truth(self) -> dict[str, Any]:
        """The channels of the truth."""
        return self._render(self.truth)

    def _render(self, scene: Any) -> dict[str, Any]:
        path = self.scratch / f"{scene.name}.exr"
        scene.render.filepath = str(path)
        try:
            with interrupt_deferred():
                bpy.ops.render.render(write_still=True, scene=scene.name)
            return read_passes(path)
        except RuntimeError as error:  # Blender's word for a disk that is full
            reason = str(error).strip().splitlines()[-1].removeprefix("Error: ")
            raise InputError(
                f"{self.scratch}: Blender could not write what it rendered ({reason}); free some space there, or set "
                "TMPDIR to a folder on another disk, and run the same command again."
            ) from None
        finally:
            path.unlink(missing_ok=True)


def make_renderer(scene: Any, plan: Plan, scratch: Path) -> Renderer:
    """Settings for the picture in `scene`, for the truth in a second scene linked to its objects."""
    across, down = plan.lens.margin_px
    size = (plan.scene.camera.width_px + 2 * across, plan.scene.camera.height_px + 2 * down)
    subdivision = 1
    if across:
        from synth.effects import lens_distortion

        subdivision = lens_distortion.SUBDIVISION
        scene.camera.data.lens = float(scene.camera.data.sensor_width * plan.K[0, 0] / size[0])
    scene.name = "picture"
    truth = bpy.data.scenes.new("truth")
    truth.collection.children.link(_shared_collection(scene))
    truth.camera, truth.world = scene.camera, scene.world
    _common(scene, size)
    _common(truth, (subdivision * size[0], subdivision * size[1]))
    _picture(scene, plan.scene.render)
    if not plan.shutter.instant:
        _blur(scene, plan.shutter, plan.scene.time.fps)
    _truth(truth)
    truth.view_layers[0].use_pass_normal = needs_normals(plan)
    if "class_id" in plan.scene.truth.passes:
        add_class_pass(truth.view_layers[0])
    return Renderer(scene, truth, scratch)


def _shared_collection(scene: Any) -> Any:
    """Moves all objects of a scene into a collection that another scene can link."""
    shared = bpy.data.collections.new("world")
    for thing in list(scene.collection.objects):
        scene.collection.objects.unlink(thing)
        shared.objects.link(thing)
    scene.collection.children.link(shared)
    return shared


def _common(scene: Any, size: tuple[int, int]) -> None:
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y, render.resolution_percentage = *size, 100
    scene.frame_current = 1  # everything is placed or keyed around this one frame
    render.pixel_aspect_x = render.pixel_aspect_y = 1.0
    render.use_motion_blur = render.use_compositing = render.use_sequencer = False
    render.use_persistent_data = True
    render.use_file_extension = False
    settings = render.image_settings
    if hasattr(settings, "media_type"):  # since Blender 5.0
        settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format, settings.color_depth, settings.exr_codec = "OPEN_EXR_MULTILAYER", "32", "NONE"
    scene.view_settings.view_transform = "Standard"
    cycles.device = "CPU"
    cycles.use_adaptive_sampling = False
    cycles.debug_bvh_type = "DYNAMIC_BVH"  # only what moved is sorted anew


def _picture(scene: Any, render: Render) -> None:
    cycles = scene.cycles
    cycles.samples = render.samples
    cycles.use_denoising = render.denoise
    if render.denoise:
        cycles.denoiser = "OPENIMAGEDENOISE"
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces = 3, 2, 2
    cycles.transmission_bounces, cycles.volume_bounces, cycles.transparent_max_bounces = 0, 0, 2
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.sample_clamp_indirect = 4.0


def _blur(scene: Any, shutter: Shutter, fps: float) -> None:
    """Cycles exposes the row at the share r from the top for S d around S (1 - d) (r - 1/2) frames, for a shutter of S
    frames and a rolling duration of d: S is readout plus exposure, S d the exposure."""
    render, cycles = scene.render, scene.cycles
    render.use_motion_blur = True
    render.motion_blur_shutter = (shutter.exposure_s + shutter.readout_s) * fps
    render.motion_blur_position = "CENTER"
    if shutter.readout_s > 0:
        cycles.rolling_shutter_type = "TOP"
        cycles.rolling_shutter_duration = shutter.exposure_s / (shutter.exposure_s + shutter.readout_s)


def _truth(scene: Any) -> None:
    cycles, layer = scene.cycles, scene.view_layers[0]
    cycles.samples, cycles.use_denoising, cycles.max_bounces = 1, False, 0
    cycles.transparent_max_bounces = 0  # ids behind a surface that lets light through would add to its own
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 0.01
    layer.use_pass_z = True
    aov = layer.aovs.add()
    aov.name, aov.type = INSTANCE, "VALUE"
