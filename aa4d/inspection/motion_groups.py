"""Anchors of what moves, and anchors of what never does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from aa4d.capture.reader import Capture
from aa4d.capture.truth import depth_of, moving_mask
from aa4d.filming.layers import displacement_m
from aa4d.methods.model_file import LoadedModel

DYNAMIC_SHARE = 0.2  # fraction of the frames that see an anchor: on a moving pixel in so many, it is dynamic
BEHIND_M = 1.0  # farther behind the depth of its pixel, an anchor is hidden
# Where there is no truth, by how far the model itself moves an anchor:
MOST_MOVED, LEAST_MOVED = 0.05, 0.5
SAMPLED_TIMES = 25


@dataclass(frozen=True)
class MotionGroups:
    static: NDArray[np.bool_]  # [N]
    dynamic: NDArray[np.bool_]  # [N]
    rule: str  # how they were told apart, for readers


def groups_by_truth(loaded: LoadedModel, capture: Capture) -> MotionGroups | None:
    """By the pixels that the anchors' moving centres fall on in every frame; None where no frame has truth."""
    model, camera = loaded.model, capture.camera
    n = len(model)
    seen, moving = np.zeros(n, np.int64), np.zeros(n, np.int64)
    for index, frame in enumerate(capture.frames):
        mask, depth = moving_mask(capture, index), depth_of(capture, index)
        if mask is None or depth is None:
            continue
        with torch.no_grad():
            position, present = model.centers(frame.t).double().numpy(), model.present(frame.t)
        world = position * loaded.frame.unit_m + loaded.frame.origin_m
        in_camera = world @ frame.viewmat[:3, :3].T + frame.viewmat[:3, 3]
        front = np.flatnonzero((in_camera[:, 2] > 0) & (True if present is None else present.numpy()))
        pixels = in_camera[front] @ camera.K.T / in_camera[front, 2:]
        inside = ((pixels[:, :2] >= 0) & (pixels[:, :2] < [camera.width, camera.height])).all(axis=1)
        rows, (x, y) = front[inside], pixels[inside, :2].astype(np.int64).T
        visible = in_camera[rows, 2] < depth[y, x] + BEHIND_M
        rows, x, y = rows[visible], x[visible], y[visible]
        seen[rows] += 1
        moving[rows] += mask[y, x]
    if not seen.any():
        return None
    return MotionGroups(
        static=(seen > 0) & (moving == 0),
        dynamic=(seen > 0) & (moving >= DYNAMIC_SHARE * seen),
        rule="by the truth of the capture: a dynamic anchor lies on a moving pixel in at least a fifth of the frames "
        "that see it, a static one in none",
    )


def groups_by_motion(loaded: LoadedModel) -> MotionGroups:
    """By the largest displacement over the clip."""
    times = np.linspace(0, 1, SAMPLED_TIMES).tolist()
    largest = torch.stack([displacement_m(loaded, t) for t in times]).amax(0).numpy()
    return MotionGroups(
        static=largest <= np.quantile(largest, LEAST_MOVED),
        dynamic=largest >= np.quantile(largest, 1 - MOST_MOVED),
        rule="by the model's own motion, as the capture has no truth or is not here: dynamic are the twentieth of the "
        "anchors that it moves farthest, static the half that it moves least",
    )
