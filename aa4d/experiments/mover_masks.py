"""How well the masks of `aa4d capture --movers auto` and `twice` cover what moves, against the truth of renderings.

    python -m aa4d.experiments.mover_masks TRUTH... --out DIR

TRUTH is a capture of `aa4d synth`. Cameras and points are the true ones; every third frame is looked at.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
from numpy.typing import NDArray
from tyro.conf import Positional, arg

from aa4d.capture.clip import Clip, ClipFrame
from aa4d.capture.movers import EpipolarMotion
from aa4d.capture.reader import Capture, read_capture
from aa4d.capture.second_look import frames_seen, second_mask
from aa4d.capture.truth import instance_ids_of, moving_mask, read_array
from aa4d.errors import InputError
from aa4d.experiments.program import run_as_program
from aa4d.files import make_folder, write_json
from aa4d.words import ONE_OR_MORE

EVERY = 3
MIN_VISIBLE_PX = 20
NEAR_SHARE = 10 / 640  # of the longest side: masked pixels so near to a mover are no fault

Mask = NDArray[np.bool_]


@dataclass
class Count:
    """Of pixels, and of vehicles that move and show enough of them."""

    moving: int = 0
    found: int = 0  # of the moving ones
    masked: int = 0
    still: int = 0  # not near to a mover
    wrong: int = 0  # masked all the same
    vehicles: int = 0
    covered: int = 0  # half of them or more
    seconds: list[float] = field(default_factory=list)  # of the processor

    def add(self, mask: Mask, moving: Mask, vehicles: list[Mask]) -> None:
        reach = int(np.ceil(NEAR_SHARE * max(mask.shape)))
        around = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1,) * 2)
        still = cv2.dilate(moving.astype(np.uint8), around) == 0
        self.moving += int(moving.sum())
        self.found += int((mask & moving).sum())
        self.masked += int(mask.sum())
        self.still += int(still.sum())
        self.wrong += int((mask & still).sum())
        self.vehicles += len(vehicles)
        self.covered += sum(bool(mask[vehicle].mean() >= 0.5) for vehicle in vehicles)

    def row(self) -> dict[str, Any]:
        return {
            "vehicles": _share(self.covered, self.vehicles),
            "recall": _share(self.found, self.moving),
            "precision": _share(self.masked - self.wrong, self.masked),
            "still_masked": _share(self.wrong, self.still),
            "cpu_s": float(np.mean(self.seconds)) if self.seconds else None,
        }


def _share(part: int, whole: int) -> float | None:
    return part / whole if whole else None


def measure(capture: Capture) -> list[dict[str, Any]]:
    """A row for each look. Raises InputError where the capture has no true tracks or ids."""
    if capture.tracks is None:
        raise InputError(f"{capture.folder}: has no true tracks; give a capture of `aa4d synth`")
    tracks = capture.folder / capture.tracks
    numbers, moves = read_array(tracks, "instance_id"), read_array(tracks, "moving")
    first = EpipolarMotion(_clip(capture))
    names = [capture.folder / frame.image for frame in capture.frames]
    viewmats = np.array([frame.viewmat for frame in capture.frames])
    seen = frames_seen(names, capture.camera.K, (capture.camera.width, capture.camera.height), viewmats, capture.points)
    counts = {"first": Count(), "auto": Count(), "twice": Count()}
    for index in range(1, len(capture.frames), EVERY):
        ids, moving = instance_ids_of(capture, index), moving_mask(capture, index)
        if ids is None or moving is None:
            raise InputError(f"{capture.folder}: has no ids of what its frames show; give a capture of `aa4d synth`")
        shown = [ids == number for number in numbers[moves[index]]]
        vehicles = [vehicle for vehicle in shown if vehicle.sum() >= MIN_VISIBLE_PX]
        mask = _timed(counts["first"], partial(first.mask, index))
        counts["first"].add(mask, moving, vehicles)
        for look, adds in (("auto", False), ("twice", True)):
            again = _timed(counts[look], partial(second_mask, seen, index, mask, adds))
            counts[look].add(again, moving, vehicles)
    return [{"capture": capture.folder.name, "look": look, **count.row()} for look, count in counts.items()]


def _timed(count: Count, make: Callable[[], Mask]) -> Mask:
    started = time.process_time()
    mask = make()
    count.seconds.append(time.process_time() - started)
    return mask


def _clip(capture: Capture) -> Clip:
    size = (capture.camera.width, capture.camera.height)
    frames = (ClipFrame(Path(f.image).name, f.name, f.time_s, None, 1.0, None) for f in capture.frames)
    return Clip(capture.folder / "frames", *size, size, tuple(frames), ())


def main(
    captures: Annotated[
        Positional[tuple[Path, ...]], arg(help="Captures with true tracks.", help_behavior_hint=ONE_OR_MORE)
    ],
    out: Annotated[Path, arg(help="Folder for table.json.")],
) -> None:
    make_folder(out)
    rows: list[dict[str, Any]] = []
    print("capture       look    vehicles  recall  precision  still masked  s a frame")
    for folder in captures:
        for row in measure(read_capture(folder)):
            rows.append(row)
            shares = ("vehicles", "recall", "precision", "still_masked")
            shown = " ".join("       -" if row[key] is None else f"{row[key]:8.2%}" for key in shares)
            print(f"{row['capture']:13} {row['look']:6} {shown}  {row['cpu_s']:8.2f}", flush=True)
        write_json(out / "table.json", {"rows": rows})


if __name__ == "__main__":
    run_as_program(main)
