"""`aa4d bench`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from aa4d.console import console
from aa4d.errors import InputError


def bench(
    what: Annotated[
        Positional[Literal["train", "raster", "precision", "scaling"]],
        arg(
            help="A training iteration part by part and how it grows; or the rasteriser's speed, what its precisions "
            "cost and leave, or how its time grows."
        ),
    ],
    json: Annotated[
        Path | None, arg(metavar="PATH", help="File to write what `train` or `raster` measured to, for machines.")
    ] = None,
    repeats: Annotated[int, arg(help="Of the rasteriser: runs of each scene; the best counts.")] = 7,
) -> None:
    """Measure training or the CPU rasteriser on this machine, on made-up scenes."""
    from aa4d.raster import bench as measure

    if repeats < 1:
        raise InputError(f"--repeats {repeats}: must be at least 1")
    if json is not None and what not in ("train", "raster"):
        raise InputError(f"--json: only `train` and `raster` write one, `{what}` does not; leave it out")
    if json is not None and not json.parent.is_dir():
        raise InputError(f"--json {json}: there is no folder {json.parent}")
    if what == "train":
        from aa4d.training import bench as training

        training.bench(json, console)
    elif what == "raster":
        measure.bench(repeats=repeats, json_path=json, console=console)
    elif what == "precision":
        measure.bench_precision(repeats, console)
    else:
        measure.bench_scaling(repeats, console)
