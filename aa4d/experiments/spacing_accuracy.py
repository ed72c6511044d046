"""How well `aa4d capture` measures the pace of movers on frames alone, against true speeds.

    python -m aa4d.experiments.spacing_accuracy TRUTH... --out DIR

TRUTH is a capture of `aa4d synth`.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from tyro.conf import Positional, arg

from aa4d.capture.reader import Capture, read_capture
from aa4d.capture.settings import Selection
from aa4d.capture.sources import open_source
from aa4d.capture.spacing import PACE_PERCENTILE, choose_spacing
from aa4d.capture.truth import instance_ids_of, read_array
from aa4d.errors import InputError
from aa4d.files import make_folder, read_json_object, write_json
from aa4d.words import ONE_OR_MORE

MIN_VISIBLE_PX = 20


def measure(capture: Capture) -> dict[str, Any]:
    """One row of the table. Raises InputError where the capture has no true tracks."""
    selection = Selection(source_fps=capture.fps)
    source = open_source(capture.folder / "frames", selection, None)
    started = time.process_time()
    pace = choose_spacing(source, selection, capture.folder, lambda *_: None).pace
    return {
        "capture": capture.folder.name,
        "frames": len(capture.frames),
        "fps": capture.fps,
        "true": true_pace(capture),
        "measured": None if pace is None else pace.lengths_per_s,
        "cpu_s": time.process_time() - started,
    }


def true_pace(capture: Capture) -> float:
    """Upper quartile of speed over length, per second, over vehicles where they move and show enough pixels.

    Raises:
        InputError: the capture has no true tracks.
    """
    if capture.tracks is None:
        raise InputError(f"{capture.folder}: has no true tracks; give a capture of `aa4d synth`")
    tracks = capture.folder / capture.tracks
    speed, moving = read_array(tracks, "speed_mps"), read_array(tracks, "moving")
    document = read_json_object(capture.folder / "capture.json", "the index of a capture")
    length_of = {instance["id"]: instance["dimensions_m"][0] for instance in document["instances"]}
    numbers = read_array(tracks, "instance_id")
    paces = []
    for index in range(len(capture.frames)):
        ids = instance_ids_of(capture, index)
        if ids is None:
            continue
        shown, pixels = np.unique(ids, return_counts=True)
        seen = np.isin(numbers, shown[pixels >= MIN_VISIBLE_PX]) & moving[index]
        paces += [speed[index, row] / length_of[int(numbers[row])] for row in np.flatnonzero(seen)]
    if not paces:
        raise InputError(f"{capture.folder}: nothing moves in it; give a capture with traffic")
    return float(np.percentile(paces, PACE_PERCENTILE))


def main(
    captures: Annotated[
        Positional[tuple[Path, ...]], arg(help="Captures with true tracks.", help_behavior_hint=ONE_OR_MORE)
    ],
    out: Annotated[Path, arg(help="Folder for table.json.")],
) -> None:
    make_folder(out)
    rows = []
    print("capture fps true measured cpu_s")
    for folder in captures:
        row = measure(read_capture(folder))
        rows.append(row)
        write_json(out / "table.json", {"rows": rows})
        measured = "-" if row["measured"] is None else f"{row['measured']:.2f}"
        print(f"{row['capture']} {row['fps']:g} {row['true']:.2f} {measured} {row['cpu_s']:.1f}", flush=True)


if __name__ == "__main__":
    tyro.cli(main)
