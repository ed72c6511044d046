"""Does the finished capture agree with itself? Read back as training reads it, and compared with the reconstruction."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aa4d.capture.reader import Capture, read_capture, read_image
from aa4d.errors import InputError

MAX_ERROR_PX = 3.0  # median reprojection error, in the frames that were reconstructed from
MAX_COLOR_DIFFERENCE = 60.0  # median difference of a point's colour from the pixel it falls on, of 255
COMPARED_FRAMES = 5
FAR_ERROR, FAR_TURN = 3.0, 6.0  # times the usual: a frame that stands out
JUMP_DEG = 8.0  # between successive frames; less is no jump
NEIGHBOURS = 5  # on each side

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ReprojectionError:
    """Error of all observations, in pixels of the capture's frames."""

    median: float
    mean: float
    p90: float


@dataclass(frozen=True)
class SelfCheck:
    reprojection_px: ReprojectionError
    frame_px: dict[str, float]  # median of each frame that shows points, by its name
    histogram: list[int]  # observations by their error, in 20 bins from 0 to 4 px
    color_difference: float  # median, of 255
    steps_m: list[float]  # between successive cameras


def check_capture(folder: Path, observations: dict[str, tuple[Floats, Floats]], shrunk: float) -> SelfCheck:
    """Compare a capture, as training reads it, with what it was reconstructed from.

    Args:
        observations: for each frame's name, points [M, 3] in world coordinates and where the frame shows them [M, 2],
            pixels of the capture's pinhole camera.
        shrunk: that camera's pixels for one pixel of the frames that were reconstructed from.

    Raises:
        InputError: poses, camera, frames and points do not belong together.
    """
    capture = read_capture(folder)
    errors = {
        frame.name: reprojection_errors_px(capture, frame.viewmat, *observations[frame.name])
        for frame in capture.frames
        if frame.name in observations and len(observations[frame.name][0])
    }
    if not errors:
        raise InputError("the self-check failed: no frame shows any point; reconstruct with --preset accurate")
    every = np.concatenate(list(errors.values()))
    color = _color_difference(capture)
    if float(np.median(every)) > MAX_ERROR_PX * shrunk or color > MAX_COLOR_DIFFERENCE:
        size = f"{capture.camera.width}x{capture.camera.height}"
        raise InputError(
            f"the self-check failed (reprojection error {np.median(every):.1f} px in frames of {size}, colors "
            f"{color:.0f} of 255 apart): the cameras do not belong to these frames; try --preset accurate"
        )
    return SelfCheck(
        ReprojectionError(float(np.median(every)), float(every.mean()), float(np.percentile(every, 90))),
        frame_px={name: float(np.median(e)) for name, e in errors.items()},
        histogram=np.histogram(every, bins=20, range=(0, 4))[0].tolist(),
        color_difference=color,
        steps_m=_steps(capture),
    )


def standing_out(names: list[str], viewmats: Floats, frame_px: dict[str, float], good_px: float) -> list[str]:
    """Frames, of those in order, of far larger error than the others, or between which the camera jumps round.

    Args:
        viewmats: [N, 4, 4].
        frame_px: median error of each frame that shows points.
        good_px: an error that is none to speak of.
    """
    usual = float(np.median(list(frame_px.values())))
    found = {name for name, error in frame_px.items() if error > max(FAR_ERROR * usual, good_px)}
    rotations = viewmats[:, :3, :3]
    traces = np.einsum("nij,nij->n", rotations[1:], rotations[:-1])
    turns_deg = np.degrees(np.arccos(np.clip((traces - 1) / 2, -1, 1)))
    for i, turn in enumerate(turns_deg):
        around = np.delete(turns_deg[max(i - NEIGHBOURS, 0) : i + NEIGHBOURS + 1], min(i, NEIGHBOURS))
        if len(around) and turn > max(FAR_TURN * float(np.median(around)), JUMP_DEG):
            found.add(names[i + 1])
    return [name for name in names if name in found]


def reprojection_errors_px(capture: Capture, viewmat: Floats, points: Floats, pixels: Floats) -> Floats:
    """[M] distances; infinite for a point behind the camera."""
    in_camera = points @ viewmat[:3, :3].T + viewmat[:3, 3]
    depth = in_camera[:, 2]
    safe = np.where(depth > 0, depth, 1.0)
    projected = (in_camera / safe[:, None]) @ capture.camera.K.T
    return np.where(depth > 0, np.linalg.norm(projected[:, :2] - pixels, axis=1), np.inf)


def _color_difference(capture: Capture) -> float:
    """Median difference between points' colours and the pixels they fall on, over some frames.

    Points hidden behind others are among them: it is a median.
    """
    K, width, height = capture.camera.K, capture.camera.width, capture.camera.height
    found = []
    for index in np.linspace(0, len(capture.frames) - 1, COMPARED_FRAMES).astype(int):
        frame = capture.frames[index]
        pixels = read_image(capture, frame)
        in_camera = capture.points @ frame.viewmat[:3, :3].T + frame.viewmat[:3, 3]
        ahead = in_camera[:, 2] > 0
        at = (in_camera[ahead] / in_camera[ahead, 2:]) @ K.T
        column, row = np.floor(at[:, 0]), np.floor(at[:, 1])
        inside = (column >= 0) & (row >= 0) & (column < width) & (row < height)
        seen = pixels[row[inside].astype(int), column[inside].astype(int)].astype(np.float64)
        found.append(np.abs(seen - capture.point_colors[ahead][inside]).mean(axis=1))
    values = np.concatenate(found)
    return float(np.median(values)) if len(values) else 255.0


def _steps(capture: Capture) -> list[float]:
    """Distances between successive cameras: a jump is a frame in the wrong place."""
    centers = np.array([-f.viewmat[:3, :3].T @ f.viewmat[:3, 3] for f in capture.frames])
    return [float(d) for d in np.linalg.norm(np.diff(centers, axis=0), axis=1)]
