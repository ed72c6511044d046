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
OF_INSTANCES = "instance_id"  # the one array of the tracks that has no row for a frame


@dataclass(frozen=True)
class Thinning:
    keep_every: int
    capture: str | None  # identity of the capture at `path`; None: the one that the task needs
    path: Path | None = location(None)


def run(call: Call) -> dict[str, Any]:
    """Raises InputError where the capture cannot be read."""
    from aa4d.capture.reader import read_capture

    settings: Thinning = call.task.settings
    source = settings.path or call.needs[0].folder
    capture = read_capture(source)
    kept = kept_frames([frame.split for frame in capture.frames], settings.keep_every)
    index = read_json_object(source / "capture.json", "the index of a capture")
    frames = [{key: index["frames"][i][key] for key in KEPT_OF_FRAMES if key in index["frames"][i]} for i in kept]
    files = [
        index["points"],
        *(frame[key] for frame in frames for key in ("image", "truth", "activity") if frame.get(key)),
    ]
    for name in files:
        _link(source / name, call.folder / name)
    if capture.tracks is not None:
        with np.load(source / capture.tracks) as tracks:
            sliced = {key: tracks[key] if key == OF_INSTANCES else tracks[key][kept] for key in tracks}
        make_folder((call.folder / capture.tracks).parent)
        with whole_file(call.folder / capture.tracks) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, **sliced)
    write_json(call.folder / "capture.json", {key: index[key] for key in KEPT if key in index} | {"frames": frames})
    return {"training_frames": sum(frame["split"] == "train" for frame in frames)}


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


KIND = Kind(run)
