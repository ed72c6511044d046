"""Uniform cubic B-splines over the clip's time, t in [0, 1]: what a track's trajectory is made of.

C control points make C - 3 segments of equal length. A control point moves the curve over four segments only, so that
what one part of the clip teaches leaves the rest alone; speed and acceleration are continuous everywhere.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Rows: the weights of four successive control points as polynomials 1, f, f^2, f^3 of the place f in a segment.
BASIS = np.array([[1.0, -3.0, 3.0, -1.0], [4.0, 0.0, -6.0, 3.0], [1.0, 3.0, 3.0, -3.0], [0.0, 0.0, 0.0, 1.0]]) / 6
FEWEST_CONTROLS = 4


def segment(t: float, controls: int) -> tuple[int, float]:
    """The segment that holds t, clamped to [0, 1], and the place in it, in [0, 1]."""
    place = min(max(t, 0.0), 1.0) * (controls - 3)
    index = min(int(place), controls - 4)
    return index, place - index


def weights_at(t: float, controls: int) -> tuple[int, Array]:
    """The first of the four control points that t depends on, and the weights [4] of those."""
    index, f = segment(t, controls)
    return index, BASIS @ np.array([1.0, f, f * f, f**3])


def design(t: Array, controls: int, derivative: int = 0) -> Array:
    """[S, C]: values of the spline at t [S] are design @ control points; `derivative` 0, 1 or 2, with respect to t."""
    t = np.atleast_1d(np.asarray(t, np.float64))
    matrix = np.zeros((len(t), controls))
    for row, time in enumerate(t):
        index, f = segment(float(time), controls)
        powers = np.array([[1.0, f, f * f, f**3], [0.0, 1.0, 2 * f, 3 * f * f], [0.0, 0.0, 2.0, 6 * f]])[derivative]
        matrix[row, index : index + 4] = BASIS @ powers * float(controls - 3) ** derivative
    return matrix


def controls_for(frames: int, fps: float, segment_s: float) -> int:
    """Control points for segments of about `segment_s` seconds, and of three frames at least."""
    clip_frames = max(frames - 1, 1)
    segments = min(clip_frames / fps / segment_s, clip_frames / 3)
    return max(round(segments), 1) + 3
