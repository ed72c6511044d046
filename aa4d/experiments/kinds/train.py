"""A method is trained on a capture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aa4d.graph.call import Call
from aa4d.graph.kinds import Kind
from aa4d.graph.task import location
from aa4d.methods.settings import RunSettings
from aa4d.training.run_folder import what_counts

REPORT_EVERY = 10  # iterations


@dataclass(frozen=True)
class Training:
    method: str
    counts: dict[str, Any]  # of the settings: those that tell this run from others
    capture: str | None  # identity of the capture at `path`; None: the one that the task needs
    settings: RunSettings = location()
    path: Path | None = location(None)

    @staticmethod
    def of(settings: RunSettings, capture: str | None, path: Path | None) -> Training:
        return Training(settings.method, what_counts(settings), capture, settings, path)


def iterations_of(settings: RunSettings) -> int:
    """Without asking the method, which would take torch."""
    motion = settings.motion
    clean = motion.clean_iterations if motion is not None and motion.needs_static else 0
    return settings.coarse_iterations + clean + settings.fine_iterations


def run(call: Call) -> dict[str, Any]:
    """Raises what training raises."""
    from aa4d.capture.reader import read_capture

    training: Training = call.task.settings
    fit(call, read_capture(training.path or call.needs[0].folder), training.settings)
    return {}


def fit(call: Call, capture: Any, settings: RunSettings) -> None:
    """Train in the call's folder, and tell how far it is."""
    from aa4d.training.schedule import schedule_of
    from aa4d.training.trainer import train

    schedule = schedule_of(settings)

    def progress(stage: str, iteration: int, total: int, loss: float, psnr_db: float, units: int) -> None:
        if iteration % REPORT_EVERY == 0 or iteration == total:
            done = schedule.iterations_before(stage) + iteration
            call.advance(done, schedule.total, loss=loss, psnr_db=psnr_db, units=units)

    train(capture, call.folder, settings, progress, say=call.say)


KIND = Kind(run)
