"""What accuracy costs in time when a capture is made: presets, with and without masks, against the true cameras.

    python -m aa4d.experiments.capture_accuracy TRUTH... --out DIR

TRUTH is a capture whose cameras are known (of `aa4d synth`), or a folder of frames, which has no pose error.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, replace
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
from aa4d.errors import InputError
from aa4d.experiments.program import run_as_program
from aa4d.files import make_folder, read_json_object, write_json
from aa4d.identity import Identity, digest_of, digest_of_file

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


def measure(source: Path, out: Path, settings: CaptureSettings) -> dict[str, Any]:
    """One row, or the one that was measured before from the same input with the same settings.

    Raises:
        InputError: the row that is there is of something else.
    """
    truth = read_capture(source) if (source / "capture.json").exists() else None
    frames = source / "frames" if truth is not None else source
    result = out.with_suffix(".json")
    identity = _identity(frames, truth, settings).as_json()
    if result.exists():
        before = read_json_object(result, "a row of the table")
        if before.get("identity") != identity:
            raise InputError(
                f"{result}: was measured from another input or with other settings; delete it and {out}, or choose a "
                "new folder with --out"
            )
        return before
    clock = Clock()
    made = make_capture(frames, out, settings, None, clock.watch)
    clock.stop()
    row = {
        "input": source.name,
        "frames": made.used,
        "preset": settings.preset,
        "movers": settings.movers,
        "registered": made.frames / made.used,
        "points": made.points,
        "reprojection_px": made.reprojection_px,
        "cpu_s": clock.seconds,
        "total_cpu_s": sum(clock.seconds.values()),
        "identity": identity,
    }
    row |= _error(made, truth) if truth is not None else {}
    write_json(result, row)
    return row


def _identity(frames: Path, truth: Capture | None, settings: CaptureSettings) -> Identity:
    files = sorted(path for path in frames.iterdir() if path.is_file())
    made_from = {"footage": digest_of({path.name: digest_of_file(path) for path in files})}
    if truth is not None:
        made_from["capture"] = truth.identity.digest()
    return Identity("evaluation", digest_of({"version": __version__, "settings": asdict(settings)}), made_from)


def _error(made: CaptureSummary, truth: Capture) -> dict[str, float]:
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
    sources: Annotated[Positional[tuple[Path, ...]], arg(help="Captures with known cameras, or folders of frames.")],
    out: Annotated[Path, arg(help="Folder for the captures and table.json.")],
    presets: tuple[str, ...] = tuple(PRESETS),
    movers: tuple[str, ...] = MOVERS,
    max_frames: tuple[int, ...] = (150,),
    threads: int = 1,
) -> None:
    make_folder(out)
    rows = []
    print("input frames preset movers registered points reprojection_px trajectory_m rotation_deg total_cpu_s")
    for source in sources:
        for count in max_frames:
            for preset in presets:
                for kind in movers:
                    settings = CaptureSettings(
                        preset, PRESETS[preset], Selection(max_frames=count), size_px=512, threads=threads
                    )
                    settings = replace(settings, movers=kind)
                    row = measure(source, out / f"{source.name}-{count}-{preset}-{kind}", settings)
                    rows.append(row)
                    write_json(out / "table.json", {"rows": rows})
                    shown = [f"{row[k]:.3f}" if k in row else "-" for k in ("trajectory_m", "rotation_deg")]
                    print(
                        f"{row['input']} {row['frames']} {preset} {kind} {row['registered']:.2f} {row['points']} "
                        f"{row['reprojection_px']:.2f} {' '.join(shown)} {row['total_cpu_s']:.0f}  "
                        + " ".join(f"{k}:{v:.0f}" for k, v in row["cpu_s"].items()),
                        flush=True,
                    )


if __name__ == "__main__":
    run_as_program(main)
