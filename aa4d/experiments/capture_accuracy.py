"""What accuracy costs in time when a capture is made: presets, with and without masks, against the true cameras.

    python -m aa4d.experiments.capture_accuracy TRUTH... --out DIR

TRUTH is a capture whose cameras are known (of `aa4d synth`), or a folder of frames, which has no pose error.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from tyro.conf import Positional, arg

from aa4d import __version__
from aa4d.capture.make import make_capture
from aa4d.capture.orientation import viewing_distance
from aa4d.capture.pose_error import pose_error
from aa4d.capture.reader import Capture, read_capture
from aa4d.capture.settings import PRESETS, CaptureSettings, Selection
from aa4d.capture.summary import CaptureSummary
from aa4d.experiments.program import rows_of_tasks, run_as_program
from aa4d.files import read_json_object
from aa4d.graph.call import Call
from aa4d.graph.kinds import Kind
from aa4d.graph.task import Task, location
from aa4d.identity import digest_of, digest_of_file
from aa4d.words import ONE_OR_MORE

MOVERS = ("off", "auto")


class Clock:
    """Processor seconds of every step, all threads together: other programs on the machine do not count."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._step, self._since = "", time.process_time()

    def watch(self, name: str, was_done: bool) -> Callable[[int, int | None], None]:  # noqa: ARG002
        self.stop()
        self._step = name
        return lambda *_: None

    def stop(self) -> None:
        now = time.process_time()
        if self._step:
            self.seconds[self._step] = now - self._since
        self._since = now


@dataclass(frozen=True)
class Making:
    frames: str  # digest of the pictures
    truth: str | None  # identity of the capture with true cameras
    settings: CaptureSettings
    source: Path = location()


def making_of(source: Path, settings: CaptureSettings) -> Making:
    """Raises InputError where `source` is a capture that cannot be read."""
    truth = read_capture(source) if (source / "capture.json").exists() else None
    files = sorted(path for path in _frames(source).iterdir() if path.is_file())
    pictures = digest_of({path.name: digest_of_file(path) for path in files})
    return Making(pictures, None if truth is None else truth.identity.digest(), settings, source.resolve())


def _frames(source: Path) -> Path:
    return source / "frames" if (source / "capture.json").exists() else source


def measure(call: Call) -> dict[str, Any]:
    """One row. Raises what `make_capture` raises."""
    making: Making = call.task.settings
    settings, clock = making.settings, Clock()
    made = make_capture(_frames(making.source), call.folder, settings, None, clock.watch)
    clock.stop()
    row = {
        "input": making.source.name,
        "frames": made.used,
        "preset": settings.preset,
        "movers": settings.movers,
        "registered": made.frames / made.used,
        "points": made.points,
        "reprojection_px": made.reprojection_px,
        "cpu_s": clock.seconds,
        "total_cpu_s": sum(clock.seconds.values()),
    }
    return row | ({} if making.truth is None else camera_error(made, read_capture(making.source)))


KIND = Kind(measure, version=__version__)


def camera_error(made: CaptureSummary, truth: Capture) -> dict[str, float]:
    """Of a capture that was made of the frames of another, whose cameras are true."""
    found = read_capture(made.folder)
    rank_of = {Path(frame.image).name: rank for rank, frame in enumerate(truth.frames)}
    labels = _labels(made.folder)
    viewmats = np.array([frame.viewmat for frame in truth.frames])
    distance = viewing_distance(viewmats, truth.points)
    ranks = [rank_of[labels[frame.name]] for frame in found.frames]
    error = pose_error(np.array([f.viewmat for f in found.frames]), viewmats[ranks], distance)
    return {
        "trajectory_m": error.trajectory_m,
        "trajectory_share": error.trajectory_m / distance,
        "rotation_deg": error.rotation_deg,
    }


def _labels(folder: Path) -> dict[str, str]:
    document = read_json_object(folder / "capture.json", "the index of a capture")
    return {frame["name"]: frame["source"] for frame in document["frames"]}


def main(
    sources: Annotated[
        Positional[tuple[Path, ...]],
        arg(help="Captures with known cameras, or folders of frames.", help_behavior_hint=ONE_OR_MORE),
    ],
    out: Annotated[Path, arg(help="Folder for the captures and table.json.")],
    presets: tuple[str, ...] = tuple(PRESETS),
    movers: tuple[str, ...] = MOVERS,
    max_frames: tuple[int, ...] = (150,),
    threads: int = 1,
) -> None:
    tasks = []
    for source in sources:
        for count in max_frames:
            for preset in presets:
                for kind in movers:
                    settings = CaptureSettings(
                        preset, PRESETS[preset], Selection(max_frames=count), size_px=512, threads=threads
                    )
                    making = making_of(source, replace(settings, movers=kind))
                    name = f"{source.name} {count} {preset} {kind}"
                    tasks.append(Task("capture-accuracy", name, making, alike=f"{preset} {kind}", units=count))
    rows = rows_of_tasks(tasks, out)
    print("input frames preset movers registered points reprojection_px trajectory_m rotation_deg total_cpu_s")
    for row in rows:
        shown = [f"{row[k]:.3f}" if k in row else "-" for k in ("trajectory_m", "rotation_deg")]
        print(
            f"{row['input']} {row['frames']} {row['preset']} {row['movers']} {row['registered']:.2f} {row['points']} "
            f"{row['reprojection_px']:.2f} {' '.join(shown)} {row['total_cpu_s']:.0f}  "
            + " ".join(f"{k}:{v:.0f}" for k, v in row["cpu_s"].items())
        )


if __name__ == "__main__":
    run_as_program(main)
