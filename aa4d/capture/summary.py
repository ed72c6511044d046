"""Summary of a finished capture, for the command and the report."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from aa4d.capture.advice import Advice
from aa4d.capture.orientation import World


@dataclass(frozen=True)
class CaptureSummary:
    folder: Path
    frames: int  # number in the capture
    used: int  # frames of the input that were tried
    points: int
    reprojection_px: float  # median, in frames of that size
    size: tuple[int, int]  # width and height of the capture's frames
    fov_deg: float  # horizontal, of the capture's frames
    world: World
    movers: str  # how they were found, and how much of the frames they cover
    notes: tuple[str, ...]
    advice: tuple[Advice, ...]
    seconds: dict[str, float]  # by step
    report: Path
