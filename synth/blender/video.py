"""Frames to a video and back, with the FFmpeg that Blender ships, through its video sequencer."""

import math
import os
import tempfile
from pathlib import Path
from typing import Any

import bpy

from synth.blender.passes import read_rgb
from synth.develop import png
from synth.errors import InputError
from synth.files import TEMPORARY_SUFFIX, write_bytes
from synth.interrupts import interrupt_deferred

EVEN_PX = 2  # encoders want even sizes
STAMPS = ("date", "time", "render_time", "frame", "scene", "camera", "filename", "memory", "hostname", "frame_range")


def through_video(
    images: list[Path], decoded: list[Path], video: Path, fps: float, codec: tuple[str, int, int]
) -> None:
    """Encode `images` to `video` and write what a player would show to `decoded`.

    `codec` is its name, the bitrate in kbit/s, and the distance of key frames.

    Raises:
        InputError: this Blender lacks the encoder.
    """
    height, width = read_rgb(images[0]).shape[:2]
    even = (width + width % EVEN_PX, height + height % EVEN_PX)
    with tempfile.TemporaryDirectory(prefix="aa4d-video-") as scratch:
        made = Path(scratch) / "video.mp4"
        _encode(images, made, even, fps, codec)
        if not made.is_file() or not made.stat().st_size:
            raise InputError(f"effects.video_compression.codec: this Blender cannot encode {codec[0]!r}; take another.")
        _decode(made, Path(scratch), even, len(images), fps)
        for number, path in enumerate(decoded, start=1):
            pixels = read_rgb(Path(scratch) / f"out{number:06d}.png")
            write_bytes(path, png(pixels[:height, :width].copy()))
        part = video.with_name(video.name + TEMPORARY_SUFFIX)
        part.write_bytes(made.read_bytes())
        os.replace(part, video)


def _scene(size: tuple[int, int], frames: int, fps: float) -> Any:
    scene = bpy.data.scenes.new("video")
    scene.sequence_editor_create()
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = *size, 100
    whole = math.ceil(fps)
    render.fps, render.fps_base = whole, whole / fps
    render.use_sequencer, render.use_file_extension = True, False
    scene.frame_start, scene.frame_end = 1, frames
    for stamp in STAMPS:  # Blender writes them into the file: the date would make every video another
        setattr(render, f"use_stamp_{stamp}", False)
    scene.view_settings.view_transform = "Standard"
    scene.sequencer_colorspace_settings.name = "sRGB"
    return scene


def _strips(scene: Any) -> Any:
    editor = scene.sequence_editor
    return editor.strips if hasattr(editor, "strips") else editor.sequences  # renamed in Blender 4.4


def _encode(images: list[Path], video: Path, size: tuple[int, int], fps: float, codec: tuple[str, int, int]) -> None:
    scene = _scene(size, len(images), fps)
    strip = _strips(scene).new_image("frames", str(images[0]), 1, 1, fit_method="ORIGINAL")
    for image in images[1:]:
        strip.elements.append(image.name)
    strip.transform.offset_x, strip.transform.offset_y = 0, 0
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):  # since Blender 5.0
        settings.media_type = "VIDEO"
    settings.file_format = "FFMPEG"
    ffmpeg = scene.render.ffmpeg
    ffmpeg.format = "MPEG4"
    name, bitrate, gop = codec
    ffmpeg.codec = name
    ffmpeg.constant_rate_factor = "NONE"
    ffmpeg.video_bitrate, ffmpeg.gopsize, ffmpeg.audio_codec = bitrate, gop, "NONE"
    ffmpeg.minrate, ffmpeg.maxrate, ffmpeg.buffersize = 0, 2 * bitrate, 4 * bitrate
    scene.render.filepath = str(video)
    _render(scene)


def _decode(video: Path, folder: Path, size: tuple[int, int], frames: int, fps: float) -> None:
    scene = _scene(size, frames, fps)
    _strips(scene).new_movie("video", str(video), 1, 1, fit_method="ORIGINAL")
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGB"
    scene.render.filepath = str(folder / "out######.png")
    _render(scene)


def _render(scene: Any) -> None:
    with interrupt_deferred():
        bpy.ops.render.render(animation=True, scene=scene.name)
