"""True and drawn motion side by side, in the colours of the flow literature: hue is direction, strength is speed."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.colors import hsv_to_rgb
from numpy.typing import NDArray

from aa4d.evaluation.true_motion import TrueMotion

DIM = 0.6  # of the picture behind, turned grey

Array = NDArray[np.float64]


def motion_picture(frame: NDArray[np.uint8], truth: TrueMotion, drawn_px: Array) -> NDArray[np.uint8]:
    """[H, 2W, 3]: left the true motion of what moves, right the drawn one at the same pixels, a colour wheel in a
    corner. Both are without the camera's motion; the strongest colour is the 99th percentile of the true speeds.

    Args:
        frame: [H, W, 3] sRGB.
        drawn_px: [P, 2] flow at the pixels of `truth`.
    """
    true_px = truth.flow_px - truth.camera_flow_px
    fastest = max(float(np.percentile(np.linalg.norm(true_px, axis=1), 99)), 1e-6)
    halves = []
    for flow in (true_px, drawn_px - truth.camera_flow_px):
        half = np.repeat(DIM * frame.mean(axis=2, keepdims=True) / 255, 3, axis=2)
        half[truth.rows, truth.columns] = flow_color(flow, fastest)
        halves.append(half)
    picture = np.concatenate(halves, axis=1)
    side = max(min(frame.shape[:2]) // 5, 8)
    offsets = np.linspace(-1, 1, side)
    wheel = np.stack(np.meshgrid(offsets, offsets), axis=-1)
    disc = np.linalg.norm(wheel, axis=-1) <= 1
    picture[:side, :side][disc] = flow_color(wheel[disc], 1.0)
    return np.asarray((picture * 255).round(), np.uint8)


def flow_color(flow: Array, fastest: float) -> Array:
    """[P, 2] -> [P, 3] sRGB in [0, 1]: white stands still, full colour moves `fastest` or faster."""
    hue = np.arctan2(flow[:, 1], flow[:, 0]) / math.tau % 1
    strength = np.clip(np.linalg.norm(flow, axis=1) / fastest, 0, 1)
    return np.asarray(hsv_to_rgb(np.stack([hue, strength, np.ones_like(hue)], axis=-1)))
