"""A capture with smaller frames: what training on fewer pixels begins with."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from aa4d.capture.reader import Capture, read_capture, read_image
from aa4d.capture.schema import PinholeCamera
from aa4d.capture.truth import moving_mask
from aa4d.capture.writing import Cloud, Shot, write_capture
from aa4d.graph.call import Call


def measure(call: Call) -> dict[str, Any]:
    """Write the capture into the task's folder."""
    settings = call.task.settings
    folder = settings.paths["capture"] if settings.paths else call.needs[0].folder
    write_scaled(read_capture(folder), settings.given["share"], call.folder)
    return {}


def write_scaled(capture: Capture, share: float, out: Path) -> None:
    """Frames of `share` times the width and height, every pixel the mean of those that it covers; masks of what moves;
    cameras and points as they are."""
    c = capture.camera
    width, height = round(c.width * share), round(c.height * share)
    across, down = width / c.width, height / c.height
    pictures = out / ".pictures"
    pictures.mkdir(parents=True, exist_ok=True)
    rows = ((np.arange(height) + 0.5) / down).astype(int)
    columns = ((np.arange(width) + 0.5) / across).astype(int)
    for index, frame in enumerate(capture.frames):
        small = Image.fromarray(read_image(capture, frame)).resize((width, height), Image.Resampling.BOX)
        small.save(pictures / f"{frame.name}.png")
        mask = moving_mask(capture, index)
        if mask is not None:
            Image.fromarray(mask[np.ix_(rows, columns)]).convert("L").save(pictures / f"{frame.name}.mask.png")
    count = len(capture.points)
    write_capture(
        out,
        capture.name,
        pictures,
        PinholeCamera(width, height, np.diag([across, down, 1.0]) @ c.K),
        [Shot(frame.name, frame.name, frame.time_s, frame.viewmat) for frame in capture.frames],
        Cloud(capture.points, capture.point_colors, np.zeros(count), np.arange(count)),
        {"scaled": share},
        made_from={"capture": capture.identity.digest()},
    )
    for path in pictures.iterdir():
        path.unlink()
    pictures.rmdir()
