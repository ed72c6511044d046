"""`aa4d train`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import FlagCreatePairsOff, Positional, arg

from aa4d.commands.choices import name_in
from aa4d.commands.settings_options import Assignments, Config
from aa4d.console import console, training_progress
from aa4d.errors import InputError
from aa4d.methods import DEFAULT

MOTION = ("tracks", "none")


def train(
    capture: Annotated[Positional[Path], arg(help="Capture folder, made by `aa4d synth` or `aa4d capture`.")],
    out: Annotated[Path, arg(help="Folder for the run: new, empty, or this run where it stopped.")],
    method: Annotated[
        str | None,
        name_in("aa4d.methods", "METHODS", "--method", DEFAULT),
        arg(help="What to train: the paper's AdaAnchor4D, or one that it is compared with."),
    ] = None,
    preset: Annotated[
        str | None,
        name_in("aa4d.methods", "preset_names", "--preset", "quick"),
        arg(
            help="quick: minutes on two cores. standard: a third of the paper's. paper: its 3,000 + 30,000 iterations, "
            "or those of the method's own paper. main: d3dgs by the main branch of its code. split-cookie: the other "
            "published configuration of modec."
        ),
    ] = None,
    config: Config = None,
    assignments: Assignments = (),
    iterations: Annotated[
        tuple[int, int] | None, arg(help="Coarse and fine iterations, instead of the preset's.", metavar="COARSE FINE")
    ] = None,
    seed: Annotated[int | None, arg(metavar="INT", help="Random seed; by default 0.")] = None,
    no_dlgd: Annotated[
        FlagCreatePairsOff[bool], arg(help="Let offsets and scales not deform (paper, section 4.3).")
    ] = False,
    no_dacw: Annotated[
        FlagCreatePairsOff[bool],
        arg(help="Do not warp the query coordinates by the anchors' density (paper, section 4.4)."),
    ] = False,
    motion: Annotated[
        str | None,
        name_in("aa4d.commands.train", "MOTION", "--motion", "tracks"),
        arg(
            help="tracks: movers are found in the training frames, and anchors ride with them (beyond the paper). "
            "none: the paper's model."
        ),
    ] = None,
    tracks: Annotated[
        str | None,
        name_in("aa4d.motion.sources", "SOURCES", "--tracks", "auto"),
        arg(
            help="Where tracks come from. auto: annotated boxes where the capture has them for several "
            "movers, else pictures. truth: those of a rendered scene, an oracle for experiments."
        ),
    ] = None,
    device: Annotated[
        str,
        name_in("aa4d.device", "DEVICES", "--device"),
        arg(help="auto: the CPU, until CUDA has trained on a real GPU."),
    ] = "auto",
    refine_poses: Annotated[
        FlagCreatePairsOff[bool],
        arg(help="Learn the training cameras' poses with the scene; for poses that are off by some pixels."),
    ] = False,
    tensorboard: Annotated[bool, arg(help="Write OUT/tensorboard; look with `tensorboard --logdir OUT`.")] = False,
) -> None:
    """Train a model on a capture; Ctrl-C stops it, and the same command continues, after `kill -9` too."""
    from aa4d.capture.reader import read_capture
    from aa4d.device import note_on_device
    from aa4d.methods.given import given_settings
    from aa4d.methods.settings import with_iterations
    from aa4d.settings.given import Given, Options
    from aa4d.training.trainer import train as run_training

    options: Options = {
        "--method": ("method", method),
        "--preset": ("preset", preset),
        "--seed": ("seed", seed),
        "--no-dlgd": ("model.dlgd", False if no_dlgd else None),
        "--no-dacw": ("model.dacw", False if no_dacw else None),
        "--refine-poses": ("refine_poses", refine_poses or None),
        "--motion": ("motion", {} if motion == "tracks" else motion),
        "--tracks": ("motion.tracks", tracks),
    }
    if motion == "none" and (idle := [given for given in assignments if given.startswith("motion.")]):
        raise InputError(f"--set {idle[0]}: has no effect with --motion none; leave one of them out")
    given = Given.by(config, assignments, options)
    settings = given_settings(given)
    if iterations is not None:
        if min(iterations) < 1:
            raise InputError(f"--iterations {iterations[0]} {iterations[1]}: both must be at least 1")
        settings = with_iterations(settings, *iterations)
    if note := note_on_device(device):  # type: ignore[arg-type]
        console.print(note, highlight=False, soft_wrap=True)
    with training_progress() as progress:
        model = run_training(
            read_capture(capture),
            out,
            settings,
            progress,
            device=device,  # type: ignore[arg-type]
            tensorboard=tensorboard,
            say=lambda sentence: console.print(sentence, highlight=False, soft_wrap=True),
        )
    console.print(f"model: {model}", highlight=False, soft_wrap=True)
