"""`aa4d train`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from aa4d.console import console, training_progress
from aa4d.errors import InputError

LARGEST_SEED = 2**63  # torch takes no larger one


def train(
    capture: Annotated[Positional[Path], arg(help="Capture folder, made by `aa4d synth` or `aa4d capture`.")],
    out: Annotated[Path, arg(help="Folder for the run: new, empty, or this run where it stopped.")],
    preset: Annotated[
        Literal["quick", "standard", "paper"],
        arg(
            help="quick: minutes on two cores. standard: a third of the paper's. paper: its 3,000 + 30,000 iterations."
        ),
    ] = "quick",
    iterations: Annotated[
        tuple[int, int] | None, arg(help="Coarse and fine iterations, instead of the preset's.", metavar="COARSE FINE")
    ] = None,
    seed: Annotated[int, arg(help="Random seed.")] = 0,
    dlgd: Annotated[bool, arg(help="Let offsets and scales deform (paper, section 4.3).")] = True,
    dacw: Annotated[bool, arg(help="Warp the query coordinates by the anchors' density (paper, section 4.4).")] = True,
    motion: Annotated[
        Literal["tracks", "none"],
        arg(
            help="tracks: movers are found in the training frames, and anchors ride with them (beyond the paper). "
            "none: the paper's model."
        ),
    ] = "tracks",
    tracks: Annotated[
        Literal["auto", "pictures", "boxes", "truth"],
        arg(
            help="Where tracks come from. auto: annotated boxes where the capture has them for several movers, else "
            "pictures. truth: those of a rendered scene, an oracle for experiments."
        ),
    ] = "auto",
    device: Annotated[
        Literal["auto", "cpu", "cuda"], arg(help="auto: the CPU, until CUDA has trained on a real GPU.")
    ] = "auto",
    refine_poses: Annotated[
        bool, arg(help="Learn the training cameras' poses with the scene; for poses that are off by some pixels.")
    ] = False,
    tensorboard: Annotated[bool, arg(help="Write OUT/tensorboard; look with `tensorboard --logdir OUT`.")] = False,
) -> None:
    """Train AdaAnchor4D on a capture; Ctrl-C stops it, and the same command continues, after `kill -9` too."""
    from aa4d.capture.reader import read_capture
    from aa4d.device import note_on_device
    from aa4d.training.config import PRESETS, MotionSettings, with_iterations
    from aa4d.training.trainer import train as run_training

    if not 0 <= seed < LARGEST_SEED:
        raise InputError(f"--seed {seed}: must be from 0 to {LARGEST_SEED - 1}")
    config = replace(PRESETS[preset], seed=seed, refine_poses=refine_poses)
    if motion == "none" and tracks != "auto":
        raise InputError(f"--tracks {tracks} belongs to --motion tracks; leave it out, or leave out --motion none")
    if motion == "tracks":
        config = replace(config, motion=MotionSettings(tracks=tracks))
    if iterations is not None:
        if min(iterations) < 1:
            raise InputError(f"--iterations {iterations[0]} {iterations[1]}: both must be at least 1")
        config = with_iterations(config, *iterations)
    if note := note_on_device(device):
        console.print(note, highlight=False, soft_wrap=True)
    with training_progress() as progress:
        model = run_training(
            read_capture(capture),
            out,
            config,
            progress,
            variant={"dlgd": dlgd, "dacw": dacw},
            device=device,
            tensorboard=tensorboard,
            say=lambda sentence: console.print(sentence, highlight=False, soft_wrap=True),
        )
    console.print(f"model: {model}", highlight=False, soft_wrap=True)
