"""`aa4d ablate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg


def ablate(
    what: Annotated[
        Positional[Literal["modules", "aggregation"]],
        arg(help="modules: product, then ACFA, DLGD and DACW. aggregation: ACFA beside its four rivals."),
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
    """Train and score the variants of one of the paper's ablation tables; stopped, the same command continues."""
    from aa4d.experiments.command import run
    from aa4d.experiments.variants import ABLATIONS

    run(ABLATIONS[what], captures, out, preset=preset, iterations=iterations, seeds=seeds, jobs=jobs)
