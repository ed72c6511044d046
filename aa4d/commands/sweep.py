"""`aa4d sweep`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg


def sweep(
    what: Annotated[
        Positional[Literal["gamma", "lambda", "smoothing", "time", "embedding"]],
        arg(help="gamma, lambda, smoothing: DACW's. time: rows of the time planes. embedding: how embeddings start."),
    ],
    captures: Annotated[Positional[tuple[Path, ...]], arg(help="Capture folders, made by `aa4d synth`.")],
    out: Annotated[Path, arg(help="Folder for the runs and the tables.")],
    seeds: Annotated[int, arg(help="Runs of each variant on each capture; they make the spread.")] = 3,
    preset: Annotated[Literal["quick", "standard", "paper"], arg(help="As of `aa4d train`.")] = "quick",
    iterations: Annotated[
        tuple[int, int] | None, arg(help="Coarse and fine iterations, instead of the preset's.", metavar="COARSE FINE")
    ] = None,
    jobs: Annotated[int, arg(help="Runs at a time; with several, each has one thread.")] = 1,
) -> None:
    """Train and score several values of a setting that the paper leaves open; stopped, the same command continues."""
    from aa4d.experiments.command import run
    from aa4d.experiments.variants import SWEEPS

    run(SWEEPS[what], captures, out, preset=preset, iterations=iterations, seeds=seeds, jobs=jobs)
