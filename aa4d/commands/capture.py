"""`aa4d capture`."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from aa4d.commands.choices import name_in
from aa4d.commands.settings_options import Assignments, Config
from aa4d.console import capture_progress, console
from aa4d.files import write_text

if TYPE_CHECKING:
    from aa4d.capture.summary import CaptureSummary


HEADING = "The settings of this capture; `aa4d capture INPUT --out FOLDER --config settings.toml` takes the same."

ENOUGH = 0.6  # share of the frames that have a pose: with less, training comes later


def capture(
    input: Annotated[  # noqa: A002, it names the argument on the command line
        Positional[Path],
        arg(help="A video, a folder of frames, a VisDrone or UAVDT sequence, or a COLMAP or nerfstudio folder."),
    ],
    out: Annotated[Path, arg(help="Folder for the capture: new, empty, or this capture where it stopped.")],
    preset: Annotated[
        str | None,
        name_in("aa4d.capture.settings", "PRESETS", "--preset", "fast"),
        arg(help="accurate: more features, pairs and adjustment, for footage that fast does not register."),
    ] = None,
    config: Config = None,
    assignments: Assignments = (),
    rate: Annotated[
        float | None, arg(metavar="FLOAT", help="Frames a second to use; by default so that movers can be followed.")
    ] = None,
    start: Annotated[float | None, arg(metavar="FLOAT", help="Second of the input to begin at; by default 0.")] = None,
    end: Annotated[float | None, arg(metavar="FLOAT", help="Second of the input to end at.")] = None,
    max_frames: Annotated[
        int | None, arg(metavar="INT", help="Frames to use at most, evenly over the range; by default 150.")
    ] = None,
    fps: Annotated[
        float | None,
        arg(metavar="FLOAT", help="Frames a second that a folder of frames was filmed with; by default 30."),
    ] = None,
    longest_px: Annotated[
        int | None,
        arg(metavar="INT", help="Longest side of the frames that are reconstructed from; by default 1600."),
    ] = None,
    size: Annotated[
        int | None,
        arg(
            metavar="INT",
            help="Longest side of the capture's frames, in pixels: training's cost grows with it; by default 1280.",
        ),
    ] = None,
    movers: Annotated[
        str | None,
        name_in("aa4d.capture.settings", "MOVERS", "--movers", "auto"),
        arg(help="auto: leave out what moves, by boxes, else by its motion. twice: and what it misses. off: no masks."),
    ] = None,
    overlay: Annotated[
        str | None,
        name_in("aa4d.capture.settings", "OVERLAYS", "--overlay", "tell"),
        arg(help="tell: say where text is burned in. leave-out: no features there, and a mask for training."),
    ] = None,
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
        arg(metavar="FLOAT", help="Meters from the camera to what it sees: the scale, where nothing else gives it."),
    ] = None,
    seed: Annotated[int | None, arg(metavar="INT", help="Random seed; by default 0.")] = None,
    threads: Annotated[int | None, arg(metavar="INT", help="Threads; by default one for each core.")] = None,
) -> None:
    """Make a capture from a drone video or its frames: cameras, points, masks of movers. Continues where it stopped."""
    from aa4d.capture.make import make_capture
    from aa4d.capture.settings import MOST_THREADS, PRESETS, CaptureSettings
    from aa4d.settings.given import Given, Options
    from aa4d.settings.toml import as_toml

    options: Options = {
        "--preset": ("preset", preset),
        "--rate": ("selection.rate", rate),
        "--start": ("selection.start_s", start),
        "--end": ("selection.end_s", end),
        "--max-frames": ("selection.max_frames", max_frames),
        "--fps": ("selection.source_fps", fps),
        "--longest-px": ("selection.longest_px", longest_px),
        "--size": ("size_px", size),
        "--movers": ("movers", movers),
        "--overlay": ("overlay", overlay),
        "--fov": ("fov_deg", fov),
        "--altitude": ("altitude_m", altitude),
        "--seed": ("seed", seed),
        "--threads": ("threads", threads),
    }
    given = Given.by(config, assignments, options)
    chosen = given.chosen("preset", PRESETS, "fast")
    cores = min(os.cpu_count() or 1, MOST_THREADS)
    settings = given.applied(CaptureSettings(chosen, PRESETS[chosen], threads=cores), chosen=["preset"])
    with capture_progress() as display:
        made = make_capture(input, out, settings, annotations, display.step)
    write_text(out / "settings.toml", as_toml(settings, HEADING))
    tell(made)


def tell(made: CaptureSummary) -> None:
    """What was made, what was left out, and what would help."""
    unit = "meters" if made.world.unit == "metres" else "not known to be meters"
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
    is_poor = made.frames < ENOUGH * made.used
    following = "what the advice says, before you train on it" if is_poor else f"aa4d train {folder} --out RUN"
    console.print(
        f"capture: {made.folder}\nreport:  {made.report}\nnext:    {following}",
        markup=False,
        highlight=False,
        soft_wrap=True,
    )
