"""Which vehicles are found as movers, at several frame rates, against the truth of rendered captures?

    python -m aa4d.experiments.track_recall CAPTURE... --out DIR

Of the training frames every first, second and third one is kept; frames in between are neither trained on nor looked
at. Each run trains the static scene as the preset `quick` does, finds the tracks as `aa4d train` would, and ends there.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from math import isnan
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import Positional, arg

from aa4d import __version__
from aa4d.capture.reader import Capture, read_capture
from aa4d.errors import InputError
from aa4d.experiments.kinds.train import fit
from aa4d.experiments.program import rows_of_tasks, run_as_program
from aa4d.graph.call import Call
from aa4d.graph.kinds import Kind
from aa4d.graph.task import Task, location
from aa4d.identity import Identity, digest_of
from aa4d.methods.adaanchor4d.settings import PRESETS, AdaAnchor4DSettings
from aa4d.methods.settings import MotionSettings, with_iterations
from aa4d.training.run_folder import what_counts
from aa4d.words import ONE_OR_MORE


def thinned(capture: Capture, every: int) -> Capture:
    """The capture with every `every`th training frame; the others belong to no split. Held-out frames stay."""
    train = capture.of_split("train")
    dropped = set(train) - set(train[::every])
    frames = tuple(replace(f, split="") if i in dropped else f for i, f in enumerate(capture.frames))
    thin = Identity("capture", digest_of({"every": every}), {"capture": capture.identity.digest()})
    return replace(capture, frames=frames, identity=thin)


@dataclass(frozen=True)
class Recall:
    capture: str  # its identity
    every: int
    counts: dict[str, Any]  # of the settings: those that tell this run from others
    training: AdaAnchor4DSettings = location()
    path: Path = location()


def measure(call: Call) -> dict[str, Any]:
    """Find and score the movers of a thinned capture. Raises what training raises."""
    from aa4d.motion.score import score_tracks
    from aa4d.motion.tracks_file import load_tracks, tracks_path

    recall: Recall = call.task.settings
    thin = thinned(read_capture(recall.path), recall.every)
    fit(call, thin, recall.training)
    score = {k: _plain(v) for k, v in asdict(score_tracks(load_tracks(tracks_path(call.folder)), thin)).items()}
    return {
        "capture": thin.folder.name,
        "fps": thin.fps / recall.every,
        "frames": len(thin.of_split("train")),
        **score,
    }


KIND = Kind(measure, version=__version__)


def _plain(value: Any) -> Any:
    """A score for a table: how many instead of which; None where nothing could be measured."""
    if isinstance(value, tuple):
        return len(value)
    return None if isinstance(value, float) and isnan(value) else value


def main(
    captures: Annotated[
        Positional[tuple[Path, ...]], arg(help="Captures with true tracks.", help_behavior_hint=ONE_OR_MORE)
    ],
    out: Annotated[Path, arg(help="Folder for the runs and table.json; stopped, the same command continues.")],
    every: Annotated[tuple[int, ...], arg(help="Keep every n-th training frame.")] = (1, 2, 3),
    iterations: Annotated[int, arg(help="Of the coarse stage.")] = PRESETS["quick"].coarse_iterations,
    seed: int = 0,
    jobs: Annotated[int, arg(help="Trainings at a time.")] = 1,
) -> None:
    if not captures or min(every, default=0) < 1:
        raise InputError("give at least one capture, and for --every numbers from 1 on")
    opened = [read_capture(folder) for folder in captures]
    for capture in opened:
        if capture.tracks is None:
            raise InputError(f"{capture.folder}: has no true tracks; give a capture of `aa4d synth`")
    # One iteration of the fine stage: the run ends as soon as the tracks are kept.
    preset = replace(PRESETS["quick"], seed=seed, motion=MotionSettings(tracks="pictures"))
    base = with_iterations(preset, iterations, 1)
    tasks = [
        Task(
            "track-recall",
            f"{capture.folder.resolve().name} {step}",
            Recall(capture.identity.digest(), step, what_counts(base), base, capture.folder.resolve()),
            alike=capture.folder.resolve().name,
        )
        for capture in opened
        for step in every
    ]
    rows = rows_of_tasks(tasks, out, jobs)
    print("capture            a second  vehicle-frames  vehicles  missed  tracks  false  split  merged  error_m")
    for row in rows:
        print(
            f"{row['capture']:18} {row['fps']:8.3g}  {row['recall']:14.1%}  {row['vehicles']:8}  {row['missed']:6}"
            f"  {row['tracks']:6}  {row['false']:5}  {row['split']:5}  {row['merged']:6}  "
            f"{'-' if row['position_error_m'] is None else format(row['position_error_m'], '.2f'):>7}"
        )


if __name__ == "__main__":
    run_as_program(main)
