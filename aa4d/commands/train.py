"""`aa4d train`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from aa4d.console import console, training_progress
from aa4d.errors import InputError


def train(
    capture: Annotated[Positional[Path], arg(help="Capture folder, made by `aa4d synth`.")],
    out: Annotated[Path, arg(help="Folder for the run: new, empty, or this run where it stopped.")],
    preset: Annotated[
        Literal["quick", "paper"], arg(help="quick: minutes on two cores. paper: its schedule.")
    ] = "quick",
    seed: Annotated[int, arg(help="Of everything random.")] = 0,
) -> None:
    """Train AdaAnchor4D on a capture; Ctrl-C stops it, and the same command continues."""
    from aa4d.capture.reader import read_capture
    from aa4d.training.config import PRESETS
    from aa4d.training.trainer import train as run_training

    if seed < 0:
        raise InputError(f"--seed {seed}: must not be negative")
    config = replace(PRESETS[preset], seed=seed)
    with training_progress() as progress:
        model = run_training(read_capture(capture), out, config, progress)
    console.print(f"model: {model}")
