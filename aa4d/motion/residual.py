"""Where a frame differs from what a static scene shows there: the pixels that may be a mover's."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from aa4d.motion.observations import Observations

BLUR_PX = 0.8
HIGH, LOW = 0.08, 0.05  # of [0, 1]: a region needs a pixel above the first and spreads above the second
SHADE = (0.3, 0.9)  # of the static scene's color: a shadow on it
SHADE_OFF = 0.03  # of [0, 1], that a shadow's color may be off from that
USUAL = 0.0125  # the residual at which thresholds begin to rise

Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]


def residuals(observed: Observations) -> Floats:
    """[V, H, W] in [0, 1]: the largest difference over the channels, blurred."""
    result = np.empty(observed.images.shape[:3], np.float32)
    for v, (image, static) in enumerate(zip(observed.images, observed.static_color, strict=True)):
        difference = cv2.GaussianBlur(image.astype(np.float32) / 255 - static, (0, 0), BLUR_PX)
        result[v] = np.abs(difference).max(axis=2)
    return result


def differing(residual: Floats) -> Mask:
    """[V, H, W]: regions above two thresholds (hysteresis)."""
    masks = np.zeros(residual.shape, bool)
    for v, frame in enumerate(residual):
        raised = max(float(np.median(frame)) / USUAL, 1.0)
        masks[v] = hysteresis(frame, LOW * raised, HIGH * raised)
    return masks


def shaded(observed: Observations) -> Mask:
    """[V, H, W]: pixels that show the static scene, only darker."""
    result = np.zeros(observed.images.shape[:3], bool)
    for v, (image, static) in enumerate(zip(observed.images, observed.static_color, strict=True)):
        here = cv2.GaussianBlur(image.astype(np.float32) / 255, (0, 0), BLUR_PX)
        static = cv2.GaussianBlur(static, (0, 0), BLUR_PX)
        share = (here * static).sum(2) / np.maximum((static * static).sum(2), 1e-6)
        off = np.abs(here - share[..., None] * static).max(axis=2)
        result[v] = (share > SHADE[0]) & (share < SHADE[1]) & (off < SHADE_OFF)
    return result


def hysteresis(values: Floats, low: float, high: float) -> Mask:
    """[H, W]: 8-connected regions above `low` that hold a pixel above `high`."""
    _, labels = cv2.connectedComponents((values > low).astype(np.uint8), connectivity=8)
    keep = np.zeros(int(labels.max()) + 1, bool)
    keep[np.unique(labels[values > high])] = True
    keep[0] = False
    return np.asarray(keep[labels])
