"""`aa4d bench`: one command for each thing that is measured."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from aa4d.commands.choices import name_in
from aa4d.console import console
from aa4d.errors import InputError

Json = Annotated[Path | None, arg(metavar="PATH", help="File to write what was measured to, for machines.")]
Repeats = Annotated[int, arg(help="Runs of each scene; the best counts.")]


def train(
    json: Json = None,
    device: Annotated[
        str,
        name_in("aa4d.device", "DEVICES", "--device"),
        arg(help="auto: the CPU, until CUDA has trained on a real GPU."),
    ] = "auto",
) -> None:
    """A training iteration part by part, and how it grows."""
    from aa4d.device import choose_device
    from aa4d.training import bench

    _check(json)
    bench.bench(json, console, device=choose_device(device))  # type: ignore[arg-type]


def raster(json: Json = None, repeats: Repeats = 7) -> None:
    """The CPU rasterizer's speed."""
    from aa4d.raster import bench

    _check(json, repeats)
    bench.bench(repeats=repeats, json_path=json, console=console)


def precision(repeats: Repeats = 7) -> None:
    """Measure the cost of the rasterizer's precisions, and what each leaves out."""
    from aa4d.raster import bench

    _check(None, repeats)
    bench.bench_precision(repeats, console)


def scaling(repeats: Repeats = 7) -> None:
    """How the rasterizer's time grows."""
    from aa4d.raster import bench

    _check(None, repeats)
    bench.bench_scaling(repeats, console)


COMMANDS: dict[str, Callable[..., None]] = {
    "train": train,
    "raster": raster,
    "precision": precision,
    "scaling": scaling,
}


def _check(json: Path | None, repeats: int = 1) -> None:
    if repeats < 1:
        raise InputError(f"--repeats {repeats}: must be at least 1")
    if json is not None and not json.parent.is_dir():
        raise InputError(f"--json {json}: there is no folder {json.parent}")
