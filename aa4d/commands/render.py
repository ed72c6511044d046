"""`aa4d render`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from aa4d.commands.choices import name_in, names_in
from aa4d.console import console, step_progress
from aa4d.errors import InputError


def render(
    run: Annotated[Positional[Path], arg(help="Folder of a run, made by `aa4d train`.")],
    out: Annotated[
        Path | None,
        arg(metavar="PATH", help="Folder for the pictures. By default one in RUN/renders, named after what it shows."),
    ] = None,
    views: Annotated[
        str,
        name_in("aa4d.filming.splits", "SPLITS", "--views"),
        arg(help="Which of the capture's frames to render, or to fly along."),
    ] = "all",
    path: Annotated[
        Path | None, arg(metavar="PATH", help="Camera path to fly instead: a JSON file, see docs/formats.md.")
    ] = None,
    frames: Annotated[int | None, arg(metavar="INT", help="Resample the path smoothly to this many views.")] = None,
    fps: Annotated[
        float | None, arg(metavar="FLOAT", help="Resample the path to this frame rate, in the same seconds.")
    ] = None,
    time: Annotated[
        float | None, arg(metavar="FLOAT", help="Freeze time at this t in [0, 1]: the camera alone moves.")
    ] = None,
    camera: Annotated[
        str | None, arg(metavar="NAME", help="Freeze the camera at the frame of this name: time alone runs.")
    ] = None,
    layers: Annotated[
        tuple[str, ...],
        names_in("aa4d.filming.layers", "NAMES", "--layers"),
        arg(
            help="What to draw. activity: how much of an anchor's aggregation weight lies on planes with time. motion: "
            "how far an anchor is from its canonical place. speed: in meters a second. movers: each rigid group in a "
            "color of its own."
        ),
    ] = ("color",),
    video: Annotated[bool, arg(help="Write an MP4 of each layer as well.")] = True,
) -> None:
    """Render a model along its capture or any camera path, at any time: PNG and MP4. Continues where it stopped."""
    from aa4d.filming.camera_path import named_path
    from aa4d.filming.film import film
    from aa4d.filming.layers import LAYERS
    from aa4d.methods.model_file import load_model

    if not layers:
        raise InputError("--layers: name at least one")
    loaded = load_model(run / "model.safetensors")
    flown, name = named_path(loaded, views, path, frames, fps, time, camera)
    folder = out or run / "renders" / name
    with step_progress("views") as progress:
        scales = film(loaded, flown, list(layers), folder, video=video, progress=progress)
    for layer, (lower, upper) in scales.items():
        console.print(
            f"{layer}: {LAYERS[layer].meaning}, {LAYERS[layer].colormap} from {lower:.4g} to {upper:.4g} "
            f"{LAYERS[layer].unit}".rstrip(),
            highlight=False,
            soft_wrap=True,
        )
    console.print(f"renders: {folder}", highlight=False, soft_wrap=True)
