"""`aa4d export`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from aa4d.commands.choices import described, name_in
from aa4d.console import console, step_progress


def export(
    run: Annotated[Positional[Path], arg(help="Folder of a run, made by `aa4d train`.")],
    format: Annotated[  # noqa: A002, it is what the option is called
        str,
        name_in("aa4d.export", "EXPORTERS", "--format"),
        arg(help=described("aa4d.export", "EXPORTERS", "description")),
    ] = "ply",
    out: Annotated[
        Path | None,
        arg(metavar="PATH", help="Folder for the files. By default one in RUN/export, named after what it holds."),
    ] = None,
    views: Annotated[
        str, name_in("aa4d.filming.splits", "SPLITS", "--views"), arg(help="Which of the capture's frames to export.")
    ] = "all",
    path: Annotated[
        Path | None,
        arg(metavar="PATH", help="Camera path whose times and places to export instead: JSON, see docs/formats.md."),
    ] = None,
    frames: Annotated[int | None, arg(metavar="INT", help="Resample time to this many views.")] = None,
    fps: Annotated[
        float | None, arg(metavar="FLOAT", help="Resample time to this frame rate, in the same seconds.")
    ] = None,
    time: Annotated[float | None, arg(metavar="FLOAT", help="Export this t in [0, 1] alone.")] = None,
    seen_from: Annotated[
        str,
        arg(
            help="Anchors look different from each side, these formats cannot: whose view to keep. `frame`: each "
            "view's own camera. `mean`: the mean of all cameras, which does not flicker. Or the name of a frame."
        ),
    ] = "frame",
    harmonics: Annotated[
        int,
        arg(
            help="Degree, 0 to 3, of the spherical harmonics that say how colors change with the side they are seen "
            "from, fitted over the training cameras. 0: they do not. Opacity and shape stay those of --seen-from."
        ),
    ] = 0,
    axes: Annotated[
        str,
        name_in("aa4d.export", "AXES", "--axes"),
        arg(help="world: z up. viewer: y down, which splat viewers show upright. Of ply, sog and points."),
    ] = "world",
) -> None:
    """Write a model for other programs, in world meters. Continues where it stopped; docs/export.md has the details."""
    from aa4d.export import EXPORTERS, what_to_open
    from aa4d.export import export as run_export
    from aa4d.export.clip import Clip, mean_eye
    from aa4d.filming.camera_path import instant_path, path_of_frames, view_of_frame
    from aa4d.methods.model_file import load_model

    loaded = load_model(run / "model.safetensors")
    flown, name = instant_path(loaded, views, path, frames, fps, time)
    if seen_from == "frame":
        eye = None
    elif seen_from == "mean":
        eye = mean_eye(path_of_frames(loaded, "all"))
    else:
        eye = view_of_frame(loaded, seen_from).center()
    folder = out or run / "export" / f"{format}-{name}{'' if eye is None else f'-from-{seen_from}'}"
    if out is None and axes != "world":
        folder = folder.with_name(f"{folder.name}-{axes}")
    if out is None and harmonics:
        folder = folder.with_name(f"{folder.name}-harmonics{harmonics}")
    with step_progress("views") as progress:
        said = run_export(Clip(loaded, flown, eye, axes, degree=harmonics), format, folder, progress)
    console.print(f"{EXPORTERS[format].description}: {what_to_open(folder)}", highlight=False, soft_wrap=True)
    if said is not None:
        console.print(said, highlight=False, soft_wrap=True)
