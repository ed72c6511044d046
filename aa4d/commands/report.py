"""`aa4d report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from aa4d.console import console
from aa4d.words import ANY_NUMBER


def report(
    folder: Annotated[
        Positional[Path],
        arg(help="Folder of a run that was scored, or what ablate, sweep, experiment or compare made."),
    ],
    out: Annotated[Path | None, arg(metavar="FILE", help="The file. By default report.html in the folder.")] = None,
    captures: Annotated[
        tuple[Path, ...],
        arg(
            help="Capture folders, where they have moved since training: for true frames.",
            help_behavior_hint=ANY_NUMBER,
        ),
    ] = (),
    megabytes: Annotated[
        float, arg(help="Of the file, at most: pictures are made smaller and fewer until it fits.")
    ] = 10.0,
) -> None:
    """Write one HTML file to look at and to send: tables that sort, plots, frames before and after, settings."""
    from aa4d.reports.report import write_report

    written = write_report(folder, out, captures=captures, megabytes=megabytes)
    for note in written.notes:
        console.print(note, highlight=False, soft_wrap=True)
    console.print(f"report: {written.path} ({written.megabytes:.2f} MB)", highlight=False, soft_wrap=True)
