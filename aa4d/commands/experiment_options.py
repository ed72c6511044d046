"""What `aa4d ablate` and `aa4d sweep` share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import OmitArgPrefixes, arg
from tyro.constructors import PrimitiveConstructorSpec

from aa4d.commands.choices import name_in
from aa4d.commands.settings_options import Assignments, Config

Jobs = Annotated[int, arg(help="Number of runs in parallel; with several, each has one thread.")]
ENGINE_HELP = arg(
    help="inline: one task after the other. processes: some at a time. ray: on the machines of a Ray cluster."
)
Address = Annotated[str | None, arg(metavar="HOST:PORT", help="Of the Ray cluster; auto: the one of this machine.")]


def engine_choice() -> PrimitiveConstructorSpec[str | None]:
    """Called where an annotation is evaluated, so that an engine entered later is a choice."""
    return name_in("aa4d.graph.engines", "ENGINES", "--engine")


@dataclass(frozen=True)
class ExperimentOptions:
    out: Annotated[Path, arg(help="Folder for the runs and the tables.")]
    seeds: Annotated[int, arg(help="Runs of each variant on each capture; they make the spread.")] = 3
    preset: Annotated[
        str | None,
        name_in("aa4d.methods.adaanchor4d.settings", "PRESETS", "--preset", "quick"),
        arg(help="Same presets as `aa4d train`."),
    ] = None
    config: Config = None
    assignments: Assignments = ()
    iterations: Annotated[
        tuple[int, int] | None, arg(help="Coarse and fine iterations, instead of the preset's.", metavar="COARSE FINE")
    ] = None
    motion: Annotated[
        str | None,
        name_in("aa4d.commands.train", "MOTION", "--motion", "none"),
        arg(help="none: the paper's model. tracks: every variant with anchors that ride on found tracks."),
    ] = None
    jobs: Jobs = 1
    engine: Annotated[str, engine_choice(), ENGINE_HELP] = "processes"
    address: Address = None


Options = OmitArgPrefixes[ExperimentOptions]
