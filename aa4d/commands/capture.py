"""`aa4d capture`."""

from __future__ import annotations

import os
import shlex
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, arg

from aa4d.console import capture_progress, console
from aa4d.errors import InputError

if TYPE_CHECKING:
    from aa4d.capture.summary import CaptureSummary

MOST_THREADS = 256  # more than cores on nearly all machines; what a system cannot start ends the whole process


def capture(
    input: Annotated[  # noqa: A002, it names the argument on the command line
        Positional[Path],
        arg(help="A video, a folder of frames, a VisDrone or UAVDT sequence, or a COLMAP or nerfstudio folder."),
    ],
    out: Annotated[Path, arg(help="Folder for the capture: new, empty, or this capture where it stopped.")],
    preset: Annotated[
        Literal["fast", "accurate"],
        arg(help="accurate: more features, pairs and adjustment, for footage that fast does not register."),
    ] = "fast",
    rate: Annotated[
        float | None, arg(metavar="FLOAT", help="Frames a second to use; by default so that movers can be followed.")
    ] = None,
    start: Annotated[float, arg(help="Second of the input to begin at.")] = 0.0,
    end: Annotated[float | None, arg(metavar="FLOAT", help="Second of the input to end at.")] = None,
    max_frames: Annotated[
        int | None, arg(metavar="INT", help="Frames to use at most, evenly over the range; by default 150.")
    ] = None,
    fps: Annotated[
        float | None,
        arg(metavar="FLOAT", help="Frames a second that a folder of frames was filmed with; by default 30."),
    ] = None,
    longest_px: Annotated[int, arg(help="Longest side of the frames that are reconstructed from.")] = 1600,
    size: Annotated[
        int, arg(help="Longest side of the capture's frames, in pixels: training's cost grows with it.")
    ] = 1280,
    movers: Annotated[
        Literal["auto", "off"],
        arg(help="auto: leave out what moves, by annotated boxes, else by its motion. off: use every feature."),
    ] = "auto",
    annotations: Annotated[
        Path | None,
        arg(metavar="PATH", help="Boxes of VisDrone or UAVDT, where they do not lie where the data set puts them."),
    ] = None,
    fov: Annotated[
        float | None,
        arg(metavar="FLOAT", help="Horizontal field of view in degrees, if known: hard to find over flat ground."),
    ] = None,
    altitude: Annotated[
        float | None,
        arg(metavar="FLOAT", help="Metres from the camera to what it sees: the scale, where nothing else gives it."),
    ] = None,
    seed: Annotated[int, arg(help="Random seed.")] = 0,
    threads: Annotated[int | None, arg(metavar="INT", help="Threads; by default one for each core.")] = None,
) -> None:
    """Make a capture from a drone video or its frames: cameras, points, masks of movers. Continues where it stopped."""
    from aa4d.capture.make import make_capture
    from aa4d.capture.schema import FARTHEST_M, MAX_SIDE_PX
    from aa4d.capture.settings import PRESETS, CaptureSettings, Selection

    for name, value, least, most in (
        ("--rate", rate, 1e-3, 1e6),
        ("--start", start, 0, 1e9),
        ("--end", end, 0, 1e9),
        ("--max-frames", max_frames, 3, 1e6),
        ("--fps", fps, 1e-3, 1e6),
        ("--longest-px", longest_px, 64, MAX_SIDE_PX),
        ("--size", size, 64, MAX_SIDE_PX),
        ("--altitude", altitude, 1e-3, FARTHEST_M),
        ("--fov", fov, 1, 150),
        ("--seed", seed, 0, 2**31 - 1),
        ("--threads", threads, 1, MOST_THREADS),
    ):
        if value is not None and not least <= value <= most:
            raise InputError(f"{name} {value:.10g}: must be at least {least:.10g} and at most {most:.10g}")
    if end is not None and not end > start:
        raise InputError(f"--end {end:g}: must lie after --start {start:g}")
    selection = Selection(
        rate=rate, start_s=start, end_s=end, max_frames=max_frames, source_fps=fps, longest_px=longest_px
    )
    settings = replace(
        CaptureSettings(preset, PRESETS[preset]),
        selection=selection,
        movers=movers,
        size_px=size,
        fov_deg=fov,
        altitude_m=altitude,
        seed=seed,
        threads=threads or os.cpu_count() or 1,
    )
    with capture_progress() as display:
        made = make_capture(input, out, settings, annotations, display.step)
    tell(made)


def tell(made: CaptureSummary) -> None:
    """What was made, what was left out, and what would help."""
    unit = "metres" if made.world.unit == "metres" else "not known to be metres"
    width, height = made.size
    error_m = made.world.gnss_error_m
    fit = "" if error_m is None else f", the cameras {error_m:.2f} m from theirs (median)"
    console.print(
        f"{made.frames} of {made.used} frames have a pose, {made.points} points, reprojection error "
        f"{made.reprojection_px:.2f} px in frames of {width}x{height}, field of view {made.fov_deg:.0f} degrees, "
        f"{sum(made.seconds.values()):.0f} s\n"
        f"scale: {unit} ({made.world.scale_from}{fit})\nup: {made.world.up_from}\nmovers: {made.movers}",
        highlight=False,
        soft_wrap=True,
    )
    for note in made.notes:
        console.print(f"note: {note}", markup=False, highlight=False, soft_wrap=True)
    for line in made.advice:
        console.print(f"advice: {line.what}", markup=False, highlight=False, soft_wrap=True)
    folder = shlex.quote(str(made.folder))
    console.print(
        f"capture: {made.folder}\nreport:  {made.report}\nnext:    aa4d train {folder} --out RUN",
        markup=False,
        highlight=False,
        soft_wrap=True,
    )
