"""`aa4d inspect`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from aa4d.console import console, step_progress


def inspect(
    run: Annotated[Positional[Path], arg(help="Folder of a run, made by `aa4d train`.")],
    capture: Annotated[
        Path | None, arg(metavar="PATH", help="Capture folder, where it has moved since training.")
    ] = None,
    out: Annotated[Path | None, arg(metavar="PATH", help="Folder for the page. By default RUN/inspect.")] = None,
) -> None:
    """Look inside a model: aggregation weights, trajectories, coordinate warp, growth of the anchors."""
    from aa4d.inspection.page import inspect as run_inspection

    with step_progress("pictures") as progress:
        page, note = run_inspection(run, capture, out or run / "inspect", progress)
    if note:
        console.print(note, highlight=False, soft_wrap=True)
    console.print(f"page: {page}", highlight=False, soft_wrap=True)
