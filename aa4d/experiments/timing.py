"""The speed of finished runs, measured alike."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from aa4d import __version__
from aa4d.experiments.kinds.evaluate import Row
from aa4d.experiments.trials import Trial
from aa4d.files import read_json_object, write_json

SPEED = "speed.json"


def time_runs(trials: list[Trial], threads: int, progress: Callable[[int, int], None]) -> dict[str, Row]:
    """Time the rendering of runs, one after the other, and write `SPEED` into each; what is there is kept.

    The figure of a run's own evaluation depends on what trained beside it.

    Args:
        threads: of rendering.

    Returns:
        "fps" and, of a method with an evaluation cache, "fps_cached", by the trial's name.
    """
    found = {}
    for number, trial in enumerate(trials, 1):
        found[trial.name] = _speed(trial, threads)
        progress(number, len(trials))
    return found


def _speed(trial: Trial, threads: int) -> Row:
    import torch

    from aa4d.evaluation.evaluate import capture_of
    from aa4d.evaluation.speed import measure_speed
    from aa4d.methods.model_file import load_model

    loaded = load_model(trial.out / "model.safetensors")
    made_by: dict[str, Any] = {"version": __version__, "model": loaded.identity.digest(), "threads": threads}
    path = trial.out / SPEED
    found = read_json_object(path, "the speed of a run") if path.exists() else {}
    if any(found.get(key) != value for key, value in made_by.items()):
        torch.set_num_threads(threads)
        speed = measure_speed(loaded, capture_of(loaded, trial.capture))
        found = made_by | {"fps": speed.fps, "fps_cached": speed.fps_cached, "cache": speed.cache}
        write_json(path, found)
    return {key: found[key] for key in ("fps", "fps_cached") if found[key] is not None}
