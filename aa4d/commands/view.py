"""`aa4d view`."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from aa4d.console import console
from aa4d.errors import InputError
from aa4d.words import ONE_OR_MORE


def view(
    runs: Annotated[
        Positional[tuple[Path, ...]],
        arg(
            metavar="RUN",
            help="Folders of runs, made by `aa4d train`; several are compared, also while they train.",
            help_behavior_hint=ONE_OR_MORE,
        ),
    ],
    capture: Annotated[
        Path | None, arg(metavar="PATH", help="Capture folder, where it has moved since training.")
    ] = None,
    host: Annotated[
        str, arg(help="Address to listen at. By default this machine alone sees the page; 0.0.0.0 lets others in.")
    ] = "127.0.0.1",
    port: Annotated[int, arg(help="Port to listen at; 0 for any that is free.")] = 8080,
) -> None:
    """Look at models in a web browser: orbit, play, layers, tracks, several at once; docs/viewer.md has the keys."""
    if not runs:
        raise InputError("aa4d view: name at least one run")
    if find_spec("viser") is None:
        raise InputError("aa4d view: needs the package viser; pip install 'aa4d[viewer]'")
    from aa4d.viewer.run import view as run_viewer

    run_viewer(
        list(runs), capture, host, port, lambda sentence: console.print(sentence, highlight=False, soft_wrap=True)
    )
