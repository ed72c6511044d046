"""A trained model in the formats of other programs: one module a format, entered in `EXPORTERS`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from aa4d.errors import InputError
from aa4d.identity import identity_of
from aa4d.output_folder import claim_folder, index_of

if TYPE_CHECKING:
    from aa4d.export.clip import Clip

INDEX = "export.json"
VERSION = 1
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Exporter:
    """`module` has a function `export(clip, out, progress)`, which writes what is not there yet into `out`.

    What it returns, a sentence or None, is told to whoever called: what the file costs. The module is imported on first
    use: what a format needs is asked of those who want it.
    """

    description: str
    module: str
    states_axes: bool = False  # the file says which way is up, so there is no choice
    needs: tuple[str, str] | None = None  # a module that is no dependency of aa4d, and the package that has it
    harmonics: bool = False  # it has room for colors that depend on the side they are seen from


USD = ("pxr", "usd-core")
FORGE = ("gaussforge", "gaussforge")
EXPORTERS = {
    "ply": Exporter("3D Gaussian splatting PLY, one file a view", "aa4d.export.splat_ply", harmonics=True),
    "glb": Exporter("glTF with splats, one file a view", "aa4d.export.splat_glb", True, harmonics=True),
    "spz": Exporter("SPZ, small splats, one file a view", "aa4d.export.splat_spz", True, FORGE, harmonics=True),
    "sog": Exporter("SOG, small splats for the web, one file a view", "aa4d.export.splat_sog", False, FORGE, True),
    "points": Exporter("point-cloud PLY with colors, one file a view", "aa4d.export.point_ply"),
    "usd": Exporter("moving splats in one USD file", "aa4d.export.usd_splats", True, USD, harmonics=True),
    "usd-points": Exporter("animated points in one USD file", "aa4d.export.usd_points", True, USD),
    "track": Exporter("Gaussians at key times, for the Blender extension", "aa4d.export.track", True),
    "html": Exporter("one page that plays the scene in a browser", "aa4d.export.html_page", True),
    "4dgs": Exporter("one file in the 4DGS container", "aa4d.export.fourdgs_container", True, ("fourdgs", "fourdgs")),
}

AXES = ("world", "viewer")  # z up, or y down
LARGEST_DEGREE = 3  # of spherical harmonics that splat files hold


def export(clip: Clip, name: str, out: Path, progress: Progress) -> str | None:
    """Write `clip` in the format `name` into the folder `out`; what a stopped export left is continued.

    Returns:
        What the exporter has to say, if anything.

    Raises:
        InputError: `out` holds something else, or the format needs a package that is not installed.
    """
    exporter = EXPORTERS[name]
    if exporter.states_axes and clip.axes != "world":
        raise InputError(f"--axes {clip.axes}: {name} states its axes, which are the world's; leave it out")
    if not 0 <= clip.degree <= LARGEST_DEGREE:
        raise InputError(f"--harmonics {clip.degree}: must be a degree from 0 to {LARGEST_DEGREE}")
    if clip.degree and not exporter.harmonics:
        able = ", ".join(other for other, its in EXPORTERS.items() if its.harmonics)
        raise InputError(f"--harmonics {clip.degree}: {name} has one color a Gaussian; leave it out, or take {able}")
    if exporter.needs is not None:
        module, package = exporter.needs
        try:
            import_module(module)
        except ImportError:
            raise InputError(f"--format {name}: needs the package {package}; pip install {package}") from None
    from aa4d.export.origin import geographic_origin

    write: Callable[[Clip, Path, Progress], str | None] = import_module(exporter.module).export
    settings = {
        "format": "aa4d-export",
        "version": VERSION,
        "exporter": name,
        "background": list(clip.loaded.background),
        "axes": clip.axes,
        "seen_from": "each view" if clip.eye is None else clip.eye.tolist(),
    }
    if clip.degree:
        settings["harmonics"] = clip.degree
    index = index_of("export", clip.loaded, settings | clip.path.as_json())
    claim_folder(out, INDEX, index, "an export")
    # The origin is in no index: an export goes on where the capture has gone in the meantime.
    known = replace(clip, identity=identity_of(index["identity"]), origin=geographic_origin(clip.loaded))
    said = write(known, out, progress)
    return said if clip.degree == 0 else "\n".join(filter(None, [said, _color_errors(known)]))


def what_to_open(out: Path) -> Path:
    """The file that an export has made, or the folder where it has made several."""
    files = [path for path in out.iterdir() if path.name != INDEX]
    return files[0] if len(files) == 1 else out


def _color_errors(clip: Clip) -> str:
    """What harmonics gain, at the middle view."""
    if all(frame.split != "test" for frame in clip.loaded.frames):
        return f"No camera was held out to tell how far colors as harmonics of degree {clip.degree} are off"
    index = len(clip) // 2
    off = clip.color_errors(index)
    return (
        f"Colors as harmonics of degree {clip.degree} are off by {off['fitted']:.4f} of their range as the held-out "
        f"cameras see them at t = {clip.path.views[index].t:.2f}; those of --seen-from alone by {off['frozen']:.4f}"
    )
