"""`aa4d synth`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from aa4d.errors import InputError


def synth(
    scene: Annotated[
        Positional[str],
        arg(
            metavar="SCENE|verify|cost|sheet",
            help="Scene file to render, for instance scenes/crossroads.toml; or `verify` and a capture folder, to "
            "check that its truth agrees with itself; or `cost` and a scene file, to measure what accuracy costs in "
            "time; or `sheet` and scene files, to see and time a few frames of each at draft quality.",
        ),
    ],
    paths: Annotated[
        Positional[tuple[Path, ...]], arg(metavar="PATH", help="What `verify`, `cost` or `sheet` is about.")
    ] = (),
    out: Annotated[
        Path | None,
        arg(
            metavar="PATH",
            help="Folder for the capture: new, empty, or an unfinished capture of this scene. With `cost` and `sheet`: "
            "where the table and the picture go.",
        ),
    ] = None,
    workers: Annotated[int, arg(help="Processes that render at the same time; the bytes are the same.")] = 1,
    explain: Annotated[bool, arg(help="Print what would be rendered, and render nothing.")] = False,
    json: Annotated[Path | None, arg(metavar="PATH", help="With `verify`: a file to write the table to.")] = None,
) -> None:
    """Render a flyover with Blender: frames, exact poses, depth and ids, as a capture folder; or check one."""
    words = {"verify": "a capture folder", "cost": "a scene file", "sheet": "scene files"}
    if scene in words and not paths:
        raise InputError(f"aa4d synth {scene}: say {words[scene]} (a scene file of that name is written ./{scene})")
    surplus = paths[0 if scene not in words else len(paths) if scene == "sheet" else 1 :]
    if surplus:
        raise InputError(
            f"aa4d synth: {str(surplus[0])!r} is one argument too many; `verify`, `cost` or `sheet` may stand first"
        )
    if json is not None and scene != "verify":
        raise InputError("--json belongs to `aa4d synth verify`")
    if scene in words and (explain or workers != 1):
        raise InputError(f"--explain and --workers belong to rendering, not to `aa4d synth {scene}`")
    if scene == "verify":
        _verify(paths[0], json, out)
    elif scene == "cost":
        _cost(paths[0], out)
    elif scene == "sheet":
        _sheet(paths, out)
    else:
        _render(Path(scene), out, workers, explain)


def _render(scene: Path, out: Path | None, workers: int, explain: bool) -> None:
    from aa4d.blender import run_in_blender

    if out is None and not explain:
        raise InputError(f"aa4d synth {scene}: --out is missing: the folder for the capture")
    arguments = [str(scene), *(["--out", str(out)] if out else []), *(["--explain"] if explain else [])]
    if workers != 1:
        arguments += ["--workers", str(workers)]
    _end(run_in_blender("synth/render_flyover.py", *arguments))


def _verify(capture: Path, json: Path | None, out: Path | None) -> None:
    from aa4d.blender import run_forwarding_interrupts, script

    if out is not None:
        raise InputError("aa4d synth verify writes no folder; --json writes its table to a file")
    command = [sys.executable, str(script("synth/verify.py")), str(capture)]
    _end(run_forwarding_interrupts([*command, *(["--json", str(json)] if json else [])]))


def _cost(scene: Path, out: Path | None) -> None:
    from aa4d.blender import run_in_blender
    from aa4d.reports.cost_plot import plot

    if out is None:
        raise InputError("aa4d synth cost: --out is missing: where the table and the plot go")
    _end(run_in_blender("synth/cost.py", str(scene), "--out", str(out)))
    plot(out / "cost.json", out / "cost.png")
    print(out / "cost.png")


def _sheet(scenes: tuple[Path, ...], out: Path | None) -> None:
    from aa4d.blender import run_in_blender
    from aa4d.reports.contact_sheet import plot

    if out is None:
        raise InputError("aa4d synth sheet: --out is missing: where the table and the contact sheet go")
    _end(run_in_blender("synth/sheet.py", *map(str, scenes), "--out", str(out)))
    plot(out / "sheet.json", out / "sheet.jpg")
    print(out / "sheet.jpg")


def _end(code: int) -> None:
    if code != 0:
        sys.exit(code if code > 0 else 1)
