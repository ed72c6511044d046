"""A capture of which only every n-th training frame is left: the held-out frames, and the world, are the same."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aa4d.files import make_folder, read_json_object, whole_file, write_json
from aa4d.graph.call import Call
from aa4d.graph.kinds import Kind
from aa4d.graph.task import location

# What else a rendered capture may hold has a row for every frame of the whole clip.
KEPT = ("format", "version", "name", "generator", "fps", "camera", "points", "tracks", "instances", "heterogeneity")
KEPT_OF_FRAMES = ("name", "image", "truth", "activity", "time_s", "t", "split", "viewmat", "viewmat_true")
MASKS = ("movers", "left_out")  # folders of pictures with the names of the frames
OF_INSTANCES = "instance_id"  # the one array of the tracks that has no row for a frame


@dataclass(frozen=True)
class Thinning:
    keep_every: int
    capture: str | None  # identity of the capture at `path`; None: the one that the task needs
    path: Path | None = location(None)


def run(call: Call) -> dict[str, Any]:
    """Raises InputError where the capture cannot be read."""
    from aa4d.capture.reader import read_capture
    from aa4d.evaluation.second_drone import FOLDER

    settings: Thinning = call.task.settings
    source = settings.path or call.needs[0].folder
    kept = kept_frames([frame.split for frame in read_capture(source).frames], settings.keep_every)
    if (source / FOLDER).is_dir():  # at the same instants
        _keep(source / FOLDER, call.folder / FOLDER, kept)
    frames = _keep(source, call.folder, kept)
    return {"training_frames": sum(frame["split"] == "train" for frame in frames)}


def _keep(source: Path, target: Path, kept: list[int]) -> list[dict[str, Any]]:
    """Make of the capture `source` one of the frames `kept`, by their ranks; returns their entries of the index."""
    index = read_json_object(source / "capture.json", "the index of a capture")
    frames = [{key: index["frames"][i][key] for key in KEPT_OF_FRAMES if key in index["frames"][i]} for i in kept]
    masks = [f"{folder}/{name}.png" for folder in MASKS for name in (*(frame["name"] for frame in frames), "all")]
    files = [
        index["points"],
        *(frame[key] for frame in frames for key in ("image", "truth", "activity") if frame.get(key)),
        *(mask for mask in masks if (source / mask).is_file()),
    ]
    for name in files:
        _link(source / name, target / name)
    if (tracks := index.get("tracks")) is not None:
        with np.load(source / tracks) as arrays:
            sliced = {key: arrays[key] if key == OF_INSTANCES else arrays[key][kept] for key in arrays}
        make_folder((target / tracks).parent)
        with whole_file(target / tracks) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, **sliced)
    write_json(target / "capture.json", {key: index[key] for key in KEPT if key in index} | {"frames": frames})
    return frames


def kept_frames(splits: list[str], keep_every: int) -> list[int]:
    """Ranks of the held-out frames and of every n-th training frame, the first included."""
    training = [rank for rank, split in enumerate(splits) if split == "train"]
    return sorted({rank for rank, split in enumerate(splits) if split != "train"} | set(training[::keep_every]))


def _link(source: Path, target: Path) -> None:
    """The same file under another name, or a copy where the file system has no such names."""
    make_folder(target.parent)
    target.unlink(missing_ok=True)  # of an interrupted try
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)


KIND = Kind(run, version="2")
