"""Two renders of a frame: the picture with many samples, the truth with one.

At one sample, unfiltered and without blur, Cycles takes depth and ids at the centre of the pixel: they are exact, where
the picture's own passes would be averages over its samples.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

from synth.blender.materials import INSTANCE
from synth.blender.passes import read_passes
from synth.interrupts import interrupt_deferred
from synth.spec import Camera, Render


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
        with interrupt_deferred():
            bpy.ops.render.render(write_still=True, scene=scene.name)
        passes = read_passes(path)
        path.unlink()
        return passes


def make_renderer(scene: Any, camera: Camera, render: Render, scratch: Path) -> Renderer:
    """Settings for the picture in `scene`, for the truth in a second scene linked to its objects."""
    scene.name = "picture"
    truth = bpy.data.scenes.new("truth")
    truth.collection.children.link(_shared_collection(scene))
    truth.camera, truth.world = scene.camera, scene.world
    for each in (scene, truth):
        _common(each, camera)
    _picture(scene, render)
    _truth(truth)
    return Renderer(scene, truth, scratch)


def _shared_collection(scene: Any) -> Any:
    """Moves all objects of a scene into a collection that another scene can link."""
    shared = bpy.data.collections.new("world")
    for thing in list(scene.collection.objects):
        scene.collection.objects.unlink(thing)
        shared.objects.link(thing)
    scene.collection.children.link(shared)
    return shared


def _common(scene: Any, camera: Camera) -> None:
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y, render.resolution_percentage = camera.width_px, camera.height_px, 100
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


def _truth(scene: Any) -> None:
    cycles, layer = scene.cycles, scene.view_layers[0]
    cycles.samples, cycles.use_denoising, cycles.max_bounces = 1, False, 0
    cycles.pixel_filter_type, cycles.filter_width = "BOX", 0.01
    layer.use_pass_z = True
    aov = layer.aovs.add()
    aov.name, aov.type = INSTANCE, "VALUE"
