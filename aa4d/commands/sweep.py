"""`aa4d sweep`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from aa4d.commands.choices import described, name_in
from aa4d.commands.experiment_options import Options
from aa4d.words import ONE_OR_MORE


def sweep(
    what: Annotated[
        Positional[str],
        name_in("aa4d.experiments.variants", "SWEEPS", "sweep"),
        arg(help=described("aa4d.experiments.variants", "SWEEPS", "title")),
    ],
    captures: Annotated[
        Positional[tuple[Path, ...]], arg(help="Capture folders, made by `aa4d synth`.", help_behavior_hint=ONE_OR_MORE)
    ],
    experiment: Options,
) -> None:
    """Train and score several values of a setting that the paper leaves open; stopped, the same command continues."""
    from aa4d.experiments.command import run
    from aa4d.experiments.variants import SWEEPS

    run(SWEEPS[what], captures, **vars(experiment))
