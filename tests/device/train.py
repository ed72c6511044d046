"""A training on a rendered capture: `quick`, scored by both rasterisers, then as much of `paper` as there is time for.

A training that is cut short leaves its checkpoint in the work folder; the next run of this part continues it.
"""

from __future__ import annotations

import json
import os
import signal
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import torch

from aa4d.capture.reader import Capture, read_capture
from aa4d.errors import Interrupted
from aa4d.evaluation.evaluate import evaluate
from aa4d.methods import DEFAULT, presets_of
from aa4d.methods.settings import RunSettings, with_iterations
from aa4d.training.schedule import schedule_of
from aa4d.training.trainer import train
from tests.device.asked import Asked, Keep, attempt

SCORING_S = 30.0  # that is kept for scoring a training that is cut short
MEASURED = Path(__file__).parents[2] / "docs/measured/presets.json"
SCORES = ("psnr", "psnr_dynamic", "psnr_still", "psnr_training", "ssim", "fps", "anchors", "training_seconds")


def measure(asked: Asked, keep: Keep) -> None:
    if asked.capture is None:
        raise ValueError("give a capture to train on, with --capture")
    capture = read_capture(Path(asked.capture))
    keep(
        "capture",
        {"name": capture.name, "frames": len(capture.frames), "size": [capture.camera.width, capture.camera.height]},
    )
    keep("on_the_cpu", on_the_cpu())
    for preset in ("quick", "paper"):
        if asked.seconds_left < SCORING_S and not asked.is_tiny:
            keep(preset, {"not_trained": "no time was left"})
            continue
        keep(preset, attempt(partial(trained_and_scored, asked, capture, preset)))


def on_the_cpu() -> dict[str, Any]:
    """What the same command came to on the CPU, by preset; one seed each."""
    rows = json.loads(MEASURED.read_text())["rows"]
    return {row["preset"]: row for row in rows if row["motion"] == "none"}


def settings_of(preset: str, is_tiny: bool) -> RunSettings:
    settings = replace(presets_of(DEFAULT)[preset], motion=None)
    return with_iterations(settings, 5, 5) if is_tiny else settings


def trained_and_scored(asked: Asked, capture: Capture, preset: str) -> dict[str, Any]:
    """Iterations, seconds, memory, and scores of what there is of the training."""
    out, settings = Path(asked.work) / "runs" / preset, settings_of(preset, asked.is_tiny)
    out.parent.mkdir(exist_ok=True)
    is_cuda = asked.device == "cuda"
    if is_cuda:
        torch.cuda.reset_peak_memory_stats()
    schedule, started = schedule_of(settings), time.perf_counter()
    done = [0]

    def progress(stage: str, iteration: int, *_: object) -> None:
        done[0] = schedule.iterations_before(stage) + iteration
        if asked.seconds_left < SCORING_S and not asked.is_tiny:
            os.kill(os.getpid(), signal.SIGINT)  # training then saves what it has, and raises Interrupted

    is_whole = True
    try:
        train(capture, out, settings, progress, device="cuda" if is_cuda else "cpu")
    except Interrupted:
        is_whole = False
    row: dict[str, Any] = {
        "finished": is_whole,
        "iterations": done[0],
        "of": schedule.total,
        "seconds_of_this_call": time.perf_counter() - started,
        "peak_mib": torch.cuda.max_memory_allocated() / 2**20 if is_cuda else None,
        "model_mib": (out / "model.safetensors").stat().st_size / 2**20,
    }
    for device in ("cpu", "cuda") if is_cuda else ("cpu",):
        metrics = evaluate(out, capture.folder, lambda *_: None, device=device).as_json()
        row[f"scores_on_{device}"] = {name: metrics.get(name) for name in SCORES}
    return row
