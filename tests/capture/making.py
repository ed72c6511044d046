"""`aa4d capture` on the small flight of aerial.py, quickly."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from aa4d.capture.clip import Clip
from aa4d.capture.make import make_capture
from aa4d.capture.orientation import umeyama
from aa4d.capture.reader import read_capture
from aa4d.capture.settings import PRESETS, CaptureSettings, Selection
from aa4d.capture.summary import CaptureSummary
from aa4d.capture.workspace import Progress, Workspace

QUICK = replace(PRESETS["fast"], features=800, longest_px=320, window=3, keyframes=4)


SETTINGS = CaptureSettings("test", QUICK, Selection(source_fps=10.0), movers="off", threads=1)


class Watch:
    """Which steps ran, and which were done before."""

    def __init__(self) -> None:
        self.ran: list[str] = []
        self.skipped: list[str] = []

    def __call__(self, name: str, was_done: bool) -> Progress:
        (self.skipped if was_done else self.ran).append(name)
        return lambda *_: None


def make(source: Path, out: Path, settings: CaptureSettings = SETTINGS, watch: Watch | None = None) -> CaptureSummary:
    return make_capture(source, out, settings, None, watch or Watch())


def clip_of(made: CaptureSummary) -> Clip:
    """The frames that a capture was made from."""
    clip = Workspace(made.folder / "work", Watch()).earlier("frames", Clip)
    assert clip is not None
    return clip


def pose_errors(folder: Path, truth: list[np.ndarray]) -> tuple[float, float]:
    """Root mean square distance (metres) and mean angle (degrees) after the best similarity."""
    capture = read_capture(folder)
    ranks = [int(Path(frame.name).stem) for frame in capture.frames]
    found = np.array([f.viewmat for f in capture.frames])
    true = np.array([truth[i] for i in ranks])
    centres, true_centres = (-np.einsum("nji,nj->ni", v[:, :3, :3], v[:, :3, 3]) for v in (found, true))
    s = umeyama(centres, true_centres)
    distance = np.sqrt(((s.of_points(centres) - true_centres) ** 2).sum(axis=1).mean())
    turned = found[:, :3, :3] @ s.rotation.T
    cosines = (np.einsum("nij,nij->n", turned, true[:, :3, :3]) - 1) / 2
    return float(distance), float(np.degrees(np.arccos(np.clip(cosines, -1, 1))).mean())
