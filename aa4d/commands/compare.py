"""`aa4d compare`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from aa4d.commands.choices import list_of, name_in
from aa4d.commands.experiment_options import ENGINE_HELP, Address, Jobs, engine_choice
from aa4d.words import ONE_OR_MORE


def compare(
    captures: Annotated[
        Positional[tuple[Path, ...]],
        arg(help="Capture folders, made by `aa4d synth` or `aa4d capture`.", help_behavior_hint=ONE_OR_MORE),
    ],
    out: Annotated[Path, arg(help="Folder for the runs, the tables and the pictures.")],
    methods: Annotated[
        tuple[str, ...] | None,
        list_of("aa4d.experiments.comparison", "entries", "--methods"),
        arg(help="all, or names with commas between them. +tracks: its anchors ride on tracked movers."),
    ] = None,
    preset: Annotated[
        str,
        name_in("aa4d.methods", "preset_names", "--preset"),
        arg(help="Same presets as `aa4d train`."),
    ] = "quick",
    iterations: Annotated[
        tuple[int, int] | None, arg(help="Coarse and fine iterations, instead of the preset's.", metavar="COARSE FINE")
    ] = None,
    seeds: Annotated[int, arg(help="Runs of each method on each capture; they make the spread.")] = 2,
    jobs: Jobs = 1,
    engine: Annotated[str, engine_choice(), ENGINE_HELP] = "processes",
    address: Address = None,
) -> None:
    """Compare methods as the paper does: its table for these captures, pictures side by side, quality against cost.

    All start from the same points, cameras and split, over as many iterations. Stopped or killed, the same command
    continues.
    """
    from aa4d.experiments.compare import compare as run
    from aa4d.experiments.comparison import entries

    run(
        captures,
        out,
        methods or entries(),
        preset=preset,
        iterations=iterations,
        seeds=seeds,
        jobs=jobs,
        engine=engine,
        address=address,
    )
