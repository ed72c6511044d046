"""`aa4d cost`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import FlagCreatePairsOff, arg

from aa4d.commands.choices import names_in
from aa4d.words import ANY_NUMBER


def cost(
    out: Annotated[Path, arg(help="Folder for the report, and for all that is measured on the way.")],
    quick: Annotated[
        FlagCreatePairsOff[bool], arg(help="Small scenes and short trainings: 15 minutes on two cores. The default.")
    ] = False,
    full: Annotated[
        FlagCreatePairsOff[bool], arg(help="The demo's scene and whole trainings: hours; how many is said first.")
    ] = False,
    panels: Annotated[
        tuple[str, ...] | None,
        names_in("aa4d.cost", "PANELS", "--panels", "all"),
        arg(help="Only these, blanks or commas between them; by default all."),
    ] = None,
    capture: Annotated[
        Path | None,
        arg(
            metavar="PATH",
            help="Capture to train on and to reconstruct, instead of one that is rendered; for panels that do either.",
        ),
    ] = None,
    plan: Annotated[
        FlagCreatePairsOff[bool], arg(help="Show what would be measured and how long it would take, and do nothing.")
    ] = False,
    costs: Annotated[
        tuple[Path, ...],
        arg(
            help="Folders of other reports, by whose measured times this one's is foretold.",
            help_behavior_hint=ANY_NUMBER,
        ),
    ] = (),
) -> None:
    """Report what accuracy costs in time, from rendering to playback. Stopped, the same command continues."""
    from aa4d.cost.panel import SIZES, Setup
    from aa4d.cost.run import run_cost, show_plan
    from aa4d.errors import InputError

    if quick and full:
        raise InputError("--quick and --full exclude each other; name one of them")
    setup = Setup(SIZES["full" if full else "quick"], capture)
    (show_plan if plan else run_cost)(setup, panels, out, costs)
