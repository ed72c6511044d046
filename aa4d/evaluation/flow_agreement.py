"""Optical flow between two pictures: what drawn motion is held against where nothing knows the true one."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

CONSISTENT_PX = 1.0  # there and back again ends within this, or the flow of that pixel is not believed


def optical_flow(start: NDArray[np.uint8], end: NDArray[np.uint8]) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """DIS flow from one picture to another, [H, W, 2] in pixels, and the pixels where going there and back agrees.

    Args:
        start, end: [H, W, 3] sRGB.
    """
    dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    gray = [cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY) for picture in (start, end)]
    height, width = gray[0].shape
    forward, backward = (
        np.asarray(dis.calc(one, other, np.zeros((height, width, 2), np.float32)), np.float32)
        for one, other in (gray, gray[::-1])
    )
    columns, rows = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    x, y = columns + forward[..., 0], rows + forward[..., 1]
    back = cv2.remap(backward, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    inside = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    return forward, inside & (np.linalg.norm(forward + back, axis=-1) < CONSISTENT_PX)
