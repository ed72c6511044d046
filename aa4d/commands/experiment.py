"""`aa4d experiment`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import FlagCreatePairsOff, Positional, arg

from aa4d.commands.experiment_options import ENGINE_HELP, Address, engine_choice
from aa4d.words import ANY_NUMBER


def experiment(
    file: Annotated[Positional[Path], arg(help="Experiment file, for instance scenes/experiments/aggregation.toml.")],
    out: Annotated[Path, arg(help="Folder for captures, runs, scores and tables.")],
    engine: Annotated[str, engine_choice(), ENGINE_HELP] = "processes",
    jobs: Annotated[
        int | None, arg(metavar="INT", help="Tasks at a time; by default one, and on a cluster what it has room for.")
    ] = None,
    address: Address = None,
    plan: Annotated[
        FlagCreatePairsOff[bool], arg(help="Show what would be run and how long it would take, and run nothing.")
    ] = False,
    part: Annotated[
        str | None, arg(metavar="I/N", help="Only every N-th run from the I-th on, and no tables: for array jobs.")
    ] = None,
    costs: Annotated[
        tuple[Path, ...],
        arg(
            help="Folders of other experiments, by whose measured times this one's is foretold.",
            help_behavior_hint=ANY_NUMBER,
        ),
    ] = (),
    tensorboard: Annotated[
        FlagCreatePairsOff[bool], arg(help="Write OUT/tensorboard; look with `tensorboard --logdir OUT`.")
    ] = False,
) -> None:
    """Render, train, score and tabulate what an experiment file says. Stopped or killed, the same command continues."""
    from aa4d.errors import InputError
    from aa4d.experiments.run_file import read_part, run_file, show_plan
    from aa4d.graph.engines import Means, check_means

    if jobs is not None and jobs < 1:
        raise InputError(f"--jobs {jobs}: must be at least 1")
    which, means = None if part is None else read_part(part), Means(jobs, address)
    check_means(engine, means)
    if plan:
        show_plan(file, out, jobs or 1, which, costs)
    else:
        run_file(file, out, engine, means, which, costs, tensorboard=tensorboard)
