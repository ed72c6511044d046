"""Every reader, a good file of its own, and what it may raise."""

from __future__ import annotations

import atexit
import json
import random
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch

from aa4d.capture.annotations import read_annotations
from aa4d.capture.content import check_content, digests_of
from aa4d.capture.gnss import read_subtitles
from aa4d.capture.reader import read_capture
from aa4d.capture.sources.transforms import read_transforms
from aa4d.errors import InputError
from aa4d.experiments.kinds.trial import KIND as TRIAL_KIND
from aa4d.experiments.tables import cells, columns_of, lines_of
from aa4d.experiments.trials import Trial, claim, task_of, trials_of
from aa4d.experiments.variants import SWEEPS
from aa4d.files import write_json
from aa4d.filming.camera_path import read_camera_path
from aa4d.methods.adaanchor4d.settings import PRESETS
from aa4d.methods.model_file import LoadedModel, load_model
from aa4d.methods.settings import with_iterations
from aa4d.motion.tracks_file import load_tracks
from aa4d.settings.given import Given
from aa4d.settings.toml import as_toml
from aa4d.training.checkpoints import load_checkpoint
from aa4d.training.history import COLUMNS, History
from aa4d.training.trainer import description_of
from synth.errors import InputError as SceneError
from synth.spec import read_scene
from tests.addon.model_files import make_model
from tests.addon.model_files import write_model as write_model_file
from tests.fuzz import mutate
from tests.toy_capture import write_toy_capture

ROOT = Path(__file__).resolve().parents[2]
Folder = Path
TRIAL = "capture/gamma-1/seed0"


@dataclass(frozen=True)
class Reader:
    """A reader of one file in a folder that it may need whole."""

    name: str
    file: str  # the one that is damaged, in the folder
    make: Callable[[Folder], object]  # writes a good folder
    mutate: Callable[[bytes, random.Random], bytes]
    read: Callable[[Path], Any]  # of the damaged file
    refuses: type[Exception]
    check: Callable[[Any], bool] = lambda _: True  # False for an accepted value that no result could have


def finite(*values: Any) -> bool:
    return all(np.isfinite(np.asarray(value, np.float64)).all() for value in values)


def _captured(capture: Any) -> bool:
    return finite(capture.fps, capture.camera.K, capture.points, *(f.viewmat for f in capture.frames)) and all(
        0 <= f.t <= 1 and abs(f.time_s) < 1e12 for f in capture.frames
    )


def copy_toy_capture(folder: Folder) -> None:
    shutil.copytree(_toy(), folder, dirs_exist_ok=True)


@cache
def _toy() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="aa4d-fuzz-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return write_toy_capture(folder / "capture", frames=3)


@cache
def model() -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    return make_model(20, groups=2)


def write_model(folder: Folder) -> None:
    write_model_file(folder / "model.safetensors", *model())


@cache
def _loaded(path: Path) -> LoadedModel:
    return load_model(path)


def _modelled(loaded: LoadedModel) -> bool:
    """Whether a model that was accepted can be evaluated."""
    with torch.no_grad():
        centers = loaded.model.centers(None if loaded.is_static else 0.5)
    return finite(loaded.fps, loaded.frame.matrix(), loaded.background) and len(centers) == len(loaded.model)


def read_with_the_extension(path: Path) -> Any:
    from addon.model import read_model

    return read_model(path)


def read_track_with_the_extension(path: Path) -> Any:
    from addon.track import read_track

    track = read_track(path)
    track.at(0.5)
    return track


def write_track(folder: Folder) -> None:
    from aa4d.export import export
    from aa4d.export.clip import Clip
    from aa4d.filming.camera_path import path_of_frames

    write_model(folder)
    loaded = load_model(folder / "model.safetensors")
    export(Clip(loaded, path_of_frames(loaded, "all"), None), "track", folder / "out", lambda *_: None)
    shutil.move(folder / "out" / "track.safetensors", folder / "track.safetensors")


def addon_error() -> type[Exception]:
    from addon.container import ModelFileError

    return ModelFileError


def write_checkpoint(folder: Folder) -> None:
    from tests.hard_cases.checkpoints import checkpoint

    (folder / "checkpoint.safetensors").write_bytes(checkpoint())


def read_checkpoint(path: Path) -> Any:
    from tests.hard_cases.checkpoints import CPU, SETTINGS

    return load_checkpoint(path, SETTINGS, CPU)


def _resumable(state: Any) -> bool:
    """Whether training could go on: a step of its optimiser leaves the shapes alone."""
    seconds = vars(state.spent).values()
    return finite(*seconds) and 0 <= state.iteration < 2**63 and min(seconds) >= 0


def write_tracks(folder: Folder) -> None:
    from aa4d.motion.tracks_file import save_tracks
    from tests.hard_cases.checkpoints import tracks

    save_tracks(folder / "tracks.npz", tracks())


def write_transforms(folder: Folder) -> None:
    frames = [{"file_path": f"images/{i:04}.png", "transform_matrix": np.eye(4).tolist()} for i in range(4)]
    camera = {
        "camera_model": "OPENCV",
        "w": 64,
        "h": 48,
        "fl_x": 60.0,
        "fl_y": 60.0,
        "cx": 32.0,
        "cy": 24.0,
        "k1": 0.01,
    }
    (folder / "transforms.json").write_text(json.dumps(camera | {"frames": frames}))


def write_camera_path(folder: Folder) -> None:
    write_model(folder)
    views = [{"name": f"v{i}", "t": i / 3, "position_m": [i, 0, 30], "look_at_m": [0, 0, 0]} for i in range(3)]
    views.append({"name": "last", "t": 1.0, "viewmat": np.eye(4).tolist()})
    camera = {"model": "PINHOLE", "width": 64, "height": 48, "K": [[60.0, 0, 32], [0, 60, 24], [0, 0, 1]]}
    document = {"format": "aa4d-camera-path", "version": 1, "fps": 10.0, "views": views, "camera": camera}
    (folder / "path.json").write_text(json.dumps(document))


def write_annotations(folder: Folder) -> None:
    rows = [f"{f},{t},{10 * t},{5 * f},20,10,1,1,{1 + t},0" for f in range(1, 6) for t in range(3)]
    (folder / "boxes.txt").write_text("\n".join(rows) + "\n")


def write_subtitles(folder: Folder) -> None:
    fields = "[iso: 100] [latitude: 48.{}] [longitude: 11.5] [rel_alt: 30.1 abs_alt: 500.2]"
    block = "{}\n00:00:0{},000 --> 00:00:0{},000\n" + fields + "\n\n"
    (folder / "clip.SRT").write_text("".join(block.format(i, i, i + 1, i) for i in range(1, 6)))


def read_positions(path: Path) -> Any:
    track = read_subtitles(path)
    return track if track is None else (track, track.at(2.5))


def write_checksums(folder: Folder) -> None:
    copy_toy_capture(folder)
    write_json(folder / "checksums.json", digests_of(folder))


def write_settings(folder: Folder) -> None:
    (folder / "run.toml").write_text(as_toml(PRESETS["quick"], "settings"))


def read_settings(path: Path) -> Any:
    given = Given.by(path)
    return given.applied(PRESETS["quick"], chosen=("preset", "method"))


def write_history(folder: Folder) -> None:
    rows = [",".join(COLUMNS), *(f"{20 * i},coarse,{20 * i},0.1,{20 + i},100,{i}.5" for i in range(1, 6))]
    (folder / "history.csv").write_text("\n".join(rows) + "\n")


def _trials(folder: Folder) -> list[Trial]:
    settings = with_iterations(PRESETS["quick"], 4, 4)
    return trials_of(SWEEPS["gamma"], [_toy()], folder, settings, 1)


@cache
def _toy_capture() -> Any:
    return read_capture(_toy())


def read_experiment(path: Path) -> Any:
    trials = _trials(path.parent)
    return claim(SWEEPS["gamma"], trials, {trials[0].capture: _toy_capture()}, path.parent)


def write_experiment(folder: Folder) -> None:
    index = read_experiment(folder / "experiment.json")
    write_json(folder / "experiment.json", index)


def write_trial(folder: Folder) -> None:
    trial = _trials(folder)[0]
    trial.out.mkdir(parents=True)
    write_json(trial.out / "config.json", description_of(_toy_capture(), trial.settings))
    row = {"capture": trial.capture.name, "variant": trial.label, "seed": trial.seed, "psnr": 20.5, "lpips.alex": 0.25}
    write_json(trial.out / "trial.json", row)


def read_trial(path: Path) -> Any:
    trial = _trials(path.parents[3])[0]
    assert TRIAL_KIND.kept is not None
    kept = TRIAL_KIND.kept(task_of(trial, _toy_capture(), path.parents[3]), trial.out)
    if kept is None:
        return None
    row = kept.result
    return (row, [cells(line, columns_of([row])) for line in lines_of(SWEEPS["gamma"], [row])])


def write_scene(folder: Folder) -> None:
    shutil.copy(ROOT / "scenes" / "tiny.toml", folder / "scene.toml")


READERS = (
    Reader("capture", "capture.json", copy_toy_capture,
           mutate.of_json, lambda p: read_capture(p.parent), InputError, _captured),
    Reader("points", "points.ply", copy_toy_capture, mutate.of_bytes, lambda p: read_capture(p.parent), InputError,
           _captured),
    Reader("transforms", "transforms.json", write_transforms, mutate.of_json, read_transforms, InputError),
    Reader("scene", "scene.toml", write_scene, mutate.of_toml, read_scene, SceneError),
    Reader("annotations", "boxes.txt", write_annotations, mutate.of_text,
           lambda p: read_annotations(p, list(range(1, 6))), InputError),
    Reader("subtitles", "clip.SRT", write_subtitles, mutate.of_text, read_positions, InputError,
           lambda found: found is None or finite(found[0].values, found[0].time_s)),
    Reader("model", "model.safetensors", write_model, mutate.of_safetensors, load_model, InputError, _modelled),
    Reader("model-in-extension", "model.safetensors", write_model, mutate.of_safetensors, read_with_the_extension,
           addon_error()),
    Reader("checkpoint", "checkpoint.safetensors", write_checkpoint, mutate.of_safetensors, read_checkpoint, InputError,
           _resumable),
    Reader("track-in-extension", "track.safetensors", write_track, mutate.of_safetensors, read_track_with_the_extension,
           addon_error()),
    Reader("tracks", "tracks.npz", write_tracks, mutate.of_npz, load_tracks, InputError),
    Reader("camera-path", "path.json", write_camera_path, mutate.of_json,
           lambda p: read_camera_path(p, _loaded(p.parent / "model.safetensors")), InputError,
           lambda path: finite(path.fps, *(v.viewmat for v in path.views)) and all(0 <= v.t <= 1 for v in path.views)),
    Reader("settings", "run.toml", write_settings, mutate.of_toml, read_settings, InputError),
    Reader("experiment", "experiment.json", write_experiment, mutate.of_json, read_experiment, InputError),
    Reader("run", f"{TRIAL}/config.json", write_trial, mutate.of_json, read_trial, InputError),
    Reader("trial", f"{TRIAL}/trial.json", write_trial, mutate.of_json, read_trial, InputError,
           lambda found: found is None or finite(*(v for v in found[0].values() if not isinstance(v, str)))),
    Reader("checksums", "checksums.json", write_checksums, mutate.of_json, lambda p: check_content(p.parent),
           InputError),
    Reader("history", "history.csv", write_history, mutate.of_text,
           lambda p: History(p.parent, 60, tensorboard=False), InputError),
)  # fmt: skip
