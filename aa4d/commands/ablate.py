"""`aa4d ablate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from aa4d.commands.choices import described, name_in
from aa4d.commands.experiment_options import Options
from aa4d.words import ONE_OR_MORE


def ablate(
    what: Annotated[
        Positional[str],
        name_in("aa4d.experiments.variants", "ABLATIONS", "ablate"),
        arg(help=described("aa4d.experiments.variants", "ABLATIONS", "title")),
    ],
    captures: Annotated[
        Positional[tuple[Path, ...]], arg(help="Capture folders, made by `aa4d synth`.", help_behavior_hint=ONE_OR_MORE)
    ],
    experiment: Options,
) -> None:
    """Train and score the variants of a table: the paper's ablations, or motion. Stopped, it continues."""
    from aa4d.experiments.command import run
    from aa4d.experiments.variants import ABLATIONS

    run(ABLATIONS[what], captures, **vars(experiment))
