"""`aa4d synth`: one command for each thing that is done with scenes."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from aa4d.errors import InputError
from aa4d.words import ONE_OR_MORE

Scene = Annotated[Positional[Path], arg(metavar="SCENE", help="Scene file, for instance scenes/crossroads.toml.")]


def render(
    scene: Scene,
    out: Annotated[
        Path | None,
        arg(metavar="PATH", help="Folder for the capture: new, empty, or an unfinished capture of this scene."),
    ] = None,
    workers: Annotated[int, arg(help="Processes that render at the same time; the bytes are the same.")] = 1,
    explain: Annotated[bool, arg(help="Print what would be rendered, and render nothing.")] = False,
) -> None:
    """Render a flyover with Blender: frames, exact poses, depth and ids, as a capture folder."""
    from aa4d.blender import run_in_blender

    if out is None and not explain:
        raise InputError(f"aa4d synth {scene}: --out is missing: the folder for the capture")
    arguments = [str(scene), *(["--out", str(out)] if out else []), *(["--explain"] if explain else [])]
    if workers != 1:
        arguments += ["--workers", str(workers)]
    _end(run_in_blender("synth/render_flyover.py", *arguments))


def verify(
    capture: Annotated[Positional[Path], arg(help="Capture folder.")],
    json: Annotated[Path | None, arg(metavar="PATH", help="File to write the table to.")] = None,
) -> None:
    """Check that a capture's truth agrees with itself."""
    from aa4d.blender import run_forwarding_interrupts, script

    command = [sys.executable, str(script("synth/verify.py")), str(capture)]
    _end(run_forwarding_interrupts([*command, *(["--json", str(json)] if json else [])]))


def cost(scene: Scene, out: Annotated[Path, arg(help="Folder for the table and the plot.")]) -> None:
    """Measure what accuracy costs in rendering time."""
    from aa4d.blender import run_in_blender
    from aa4d.reports.cost_plot import plot

    _end(run_in_blender("synth/cost.py", str(scene), "--out", str(out)))
    plot(out / "cost.json", out / "cost.png")
    print(out / "cost.png")


def sheet(
    scenes: Annotated[
        Positional[tuple[Path, ...]], arg(metavar="SCENE ...", help="Scene files.", help_behavior_hint=ONE_OR_MORE)
    ],
    out: Annotated[Path, arg(help="Folder for the table and the contact sheet.")],
) -> None:
    """See and time a few frames of each scene at draft quality."""
    from aa4d.blender import run_in_blender
    from aa4d.reports.contact_sheet import plot

    if not scenes:
        raise InputError("aa4d synth sheet: name at least one scene file")
    _end(run_in_blender("synth/sheet.py", *map(str, scenes), "--out", str(out)))
    plot(out / "sheet.json", out / "sheet.jpg")
    print(out / "sheet.jpg")


COMMANDS: dict[str, Callable[..., None]] = {"render": render, "verify": verify, "cost": cost, "sheet": sheet}


def _end(code: int) -> None:
    if code != 0:
        sys.exit(code if code > 0 else 1)
