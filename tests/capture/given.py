"""Folders whose cameras are known, and photographs, for tests to open."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from aa4d.capture.schema import PinholeCamera
from aa4d.capture.settings import PRESETS, CaptureSettings, Selection
from aa4d.capture.sources import Source, open_source
from aa4d.capture.workspace import Progress
from aa4d.capture.writing import Cloud, Shot, write_capture
from tests.capture import aerial

QUICK = replace(PRESETS["fast"], features=800, longest_px=320, window=3, keyframes=4)


SETTINGS = CaptureSettings("test", QUICK, Selection(source_fps=10.0), threads=1)


def silent(*_: object) -> Progress:
    return lambda *_: None


def given(folder: Path, with_points: bool) -> Path:
    """A folder with frames, true cameras and, if wanted, points, as `aa4d synth` writes them."""
    truth = aerial.arc()
    aerial.write(folder / "pictures", aerial.pictures(truth), "{:06}.png")
    generator = np.random.default_rng(0)
    ground = np.column_stack([generator.uniform(-12, 12, (400, 2)), np.zeros(400)])
    ground[:40, 2] = 6.0
    # The colours that the frames show there, for the self-check.
    first = truth[4]
    in_camera = ground @ first[:3, :3].T + first[:3, 3]
    at = (in_camera / in_camera[:, 2:]) @ aerial.K.T
    image = aerial.pictures([first])[0]
    colors = image[np.clip(at[:, 1].astype(int), 0, 239), np.clip(at[:, 0].astype(int), 0, 319)]
    cloud = Cloud(ground, colors.astype(np.uint8), np.ones(400), np.arange(400))
    shots = [Shot(f"{i:06}", f"{i:06}", i / 10, v) for i, v in enumerate(truth)]
    camera = PinholeCamera(aerial.WIDTH, aerial.HEIGHT, aerial.K)
    write_capture(folder, "given", folder / "pictures", camera, shots, cloud, {})
    if not with_points:
        import shutil

        shutil.rmtree(folder / "sparse")
    return folder


def foreign(folder: Path, change: Callable[[Any], object], name: str = "transforms.json") -> Source:
    """A nerfstudio folder that another program made; `change` edits the cameras."""
    source = given(folder, with_points=False)
    document = json.loads((source / "transforms.json").read_text())
    for file in ("capture.json", "transforms.json"):
        (source / file).unlink()
    change(document)
    (source / name).write_text(json.dumps(document))
    return open_source(source, Selection(), None)


def photograph(path: Path, taken: str | None) -> None:
    exif = Image.Exif()
    if taken is not None:
        exif.get_ifd(0x8769)[0x9003] = taken
    Image.new("RGB", (64, 48), (90, 120, 60)).save(path, exif=exif)


def edited(folder: Path, file: str, old: str, new: str) -> None:
    """The first match of `old` in a text file of a COLMAP model, replaced."""
    path = folder / "sparse/0" / file
    text, count = re.subn(old, new, path.read_text(), count=1)
    assert count == 1
    path.write_text(text)
